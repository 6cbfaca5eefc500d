"""What a row of distilled lobes costs: eager, compiled, in ONNX Runtime, beside one bounce and a path of the exact estimator.

python benchmarks/distilled_speed.py [--rows 262144] [--alpha-map]
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import tyro
from record import compiled_anew, first_call, save, timed
from torch import Tensor

import torchms as ms
from torchms.approximations.distil.scenes import hemisphere
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


def row_of(case: dict[str, Any]) -> str:
    """A line of the table."""
    numbers = [f"{case['ns'][what]:.0f}" if what in case["ns"] else "" for what in ("eager", "compiled", "onnx")]
    numbers += [f"{case['first_call_s']:.1f}", f"{case['onnx_bytes'] / 1e3:.0f}" if case["onnx_bytes"] else ""]
    return f"| {case['case']} | {' | '.join(numbers)} |"


@torch.no_grad()
def main(options: Options) -> None:
    """Time all cases in turns, print a table and keep it in results/."""
    rows, generator = options.rows, generator_for(1)
    wi, wo = hemisphere(rows, generator), hemisphere(rows, generator)
    alpha = draw((rows,), 1, 1, generator=generator)[:, 0, 0] * 0.8 + 0.1 if options.alpha_map else 0.5
    found, calls = [], []
    with tempfile.TemporaryDirectory() as place, compiled_anew():
        for name, bsdf in cases(alpha).items():
            compiled = call_of(ms.compile(bsdf, verbose=False), wi, wo)
            case = {"case": name, "rows": rows, "first_call_s": first_call(compiled), "onnx_bytes": 0, "ns": {}}
            kinds = {"eager": call_of(bsdf, wi, wo), "compiled": compiled}
            if bsdf.scattering.is_deterministic(bsdf.vertex) and not options.alpha_map:
                kinds["onnx"], case["onnx_bytes"] = exported(bsdf, wi, wo, Path(place))
            found.append(case)
            calls += [(case["ns"], kind, call) for kind, call in kinds.items()]
        times = timed(*(call for _, _, call in calls), repeats=options.repetitions)
    for (ns, kind, _), seconds in zip(calls, times, strict=True):
        ns[kind] = seconds / rows * 1e9
    print(
        "| ns a row | eager | compiled | ONNX Runtime | first compiled call, s | file, kB |", "|---" * 6 + "|", sep="\n"
    )
    print("\n".join(row_of(case) for case in found))
    save("distilled_speed_map" if options.alpha_map else "distilled_speed", found)


if __name__ == "__main__":
    main(tyro.cli(Options))
