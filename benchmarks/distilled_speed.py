"""What a row of distilled lobes costs: eager, compiled, in ONNX Runtime, beside one bounce and a path of the exact estimator.

python benchmarks/distilled_speed.py [--rows 262144] [--alpha-map]
"""

import contextlib
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import tyro
from record import save
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor, Dielectric, Ideal
from torchms.sampling.uniforms import draw, generator_for


@dataclass
class Options:
    """Cost of distilled lobes."""

    rows: int = 1 << 18
    """Pairs of directions a call."""
    repetitions: int = 9
    """Rounds of all cases in turns; the table shows the median of a case."""
    alpha_map: bool = False
    """A roughness for every row, in place of one."""


def cases(alpha: float | Tensor) -> dict[str, ms.BSDF]:
    """The lobes that come with torchms, and what they are compared with."""
    ggx, beckmann, gaussian = ms.GGX(alpha), ms.Beckmann(alpha), ms.Distilled(surface="gaussian")
    gold, glass, chalk = Conductor.metal("Au"), Dielectric(1.5), [0.8, 0.5, 0.2]
    return {
        "one bounce, F = 1": ms.RoughConductor(ggx, Ideal(), ms.SingleBounce()),
        "one path, `Bidirectional(Invariance(), 6)`, F = 1": ms.RoughConductor(
            ggx, Ideal(), ms.Bidirectional(ms.Invariance(), 6)
        ),
        "one path, `HeightWalk()`, glass": ms.RoughDielectric(ggx, glass, ms.HeightWalk()),
        "metal, F = 1": ms.RoughConductor(ggx, Ideal(), ms.Distilled()),
        "gold": ms.RoughConductor(ggx, gold, ms.Distilled()),
        "diffuse, RGB": ms.RoughDiffuse(ggx, chalk, ms.Distilled()),
        "glass, GGX": ms.RoughDielectric(ggx, glass, ms.Distilled()),
        "glass, Beckmann": ms.RoughDielectric(beckmann, glass, ms.Distilled()),
        "gaussian metal, F = 1": ms.RoughConductor(beckmann, Ideal(), gaussian),
        "gaussian diffuse, RGB": ms.RoughDiffuse(beckmann, chalk, gaussian),
    }


def directions(rows: int) -> tuple[Tensor, Tensor]:
    """wi above the horizon, wo above it."""
    u = draw((2,), rows, 2, generator=generator_for(1))
    z, phi = u[..., 0].clamp(0.01, 0.99), 2 * torch.pi * u[..., 1]
    r = (1 - z * z).sqrt()
    wi, wo = torch.stack([r * phi.cos(), r * phi.sin(), z], -1)
    return wi, wo


def call_of(bsdf: ms.BSDF, wi: Tensor, wo: Tensor) -> Callable[[], Any]:
    """One value a row, with one path where that takes random numbers."""
    if bsdf.vertex.transmits:
        # Half of the rows are seen from the other side.
        wo = torch.where((torch.arange(len(wo)) % 2 == 0)[:, None], wo, wo * torch.tensor([1.0, 1.0, -1.0]))
    if bsdf.scattering.is_deterministic(bsdf.vertex):
        return lambda: bsdf(wi, wo)
    return lambda: bsdf(wi, wo, ms.Stream(1, 1))


def exported(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, folder: Path) -> tuple[Callable[[], Any], int]:
    """A call of the exported file, two threads, and its size [bytes]."""
    path = ms.onnx.export(bsdf, folder / "evaluator.onnx", force=True)
    evaluator = ms.onnx.Evaluator(path, threads=torch.get_num_threads())
    return lambda: evaluator(wi, wo), path.stat().st_size


def compiled(bsdf: ms.BSDF, wi: Tensor, wo: Tensor) -> tuple[Callable[[], Any], float]:
    """A call in machine code, and the time of the first one [s], with nothing kept from before."""
    call = call_of(ms.compile(bsdf, verbose=False), wi, wo)
    start = time.perf_counter()
    call()
    return call, time.perf_counter() - start


def row_of(case: dict[str, Any]) -> str:
    """A line of the table."""
    numbers = [f"{case['ns'][what]:.0f}" if what in case["ns"] else "" for what in ("eager", "compiled", "onnx")]
    numbers += [f"{case['first_call_s']:.1f}", f"{case['onnx_bytes'] / 1e3:.0f}" if case["onnx_bytes"] else ""]
    return f"| {case['case']} | {' | '.join(numbers)} |"


@torch.no_grad()
def main(options: Options) -> None:
    """Time all cases in turns, print a table and keep it in results/."""
    wi, wo = directions(options.rows)
    alpha = (
        0.5 if not options.alpha_map else draw((1,), options.rows, 1, generator=generator_for(2))[0, :, 0] * 0.8 + 0.1
    )
    found, calls = [], []
    with tempfile.TemporaryDirectory() as place, cache_in(Path(place)):
        for name, bsdf in cases(alpha).items():
            call, first = compiled(bsdf, wi, wo)
            kinds, size = {"eager": call_of(bsdf, wi, wo), "compiled": call}, 0
            if bsdf.scattering.is_deterministic(bsdf.vertex) and not options.alpha_map:
                kinds["onnx"], size = exported(bsdf, wi, wo, Path(place))
            found.append({"case": name, "rows": options.rows, "first_call_s": first, "onnx_bytes": size})
            calls.append(kinds)
        times = [{what: [] for what in kinds} for kinds in calls]
        for _ in range(options.repetitions):
            for kinds, mine in zip(calls, times, strict=True):
                for what, call in kinds.items():
                    start = time.perf_counter()
                    call()
                    mine[what].append(time.perf_counter() - start)
    print(
        "| ns a row | eager | compiled | ONNX Runtime | first compiled call, s | file, kB |\n|---|---|---|---|---|---|"
    )
    for case, mine in zip(found, times, strict=True):
        case["ns"] = {what: statistics.median(t) / options.rows * 1e9 for what, t in mine.items()}
        case["ns_least"] = {what: min(t) / options.rows * 1e9 for what, t in mine.items()}
        print(row_of(case))
    save("distilled_speed_map" if options.alpha_map else "distilled_speed", found)


@contextlib.contextmanager
def cache_in(folder: Path) -> Iterator[None]:
    """Machine code is kept there, so that it is compiled anew."""
    before = os.environ.get("TORCHINDUCTOR_CACHE_DIR")
    os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(folder)
    try:
        yield
    finally:
        os.environ.pop("TORCHINDUCTOR_CACHE_DIR")
        if before is not None:
            os.environ["TORCHINDUCTOR_CACHE_DIR"] = before


if __name__ == "__main__":
    main(tyro.cli(Options))
