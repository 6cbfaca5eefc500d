"""How many values, samples and walks a second does each material give in each scattering? Eager, in blocks."""

import argparse
from typing import Any

import torch
from record import save, seconds

import torchms as ms
from torchms.fresnel import Conductor, Dielectric, Ideal


def cases(K: int) -> dict[str, ms.BSDF]:
    """Every material × scattering, GGX α = 0.5, and the conductor with Beckmann."""
    ggx = ms.GGX(0.5)
    found: dict[str, ms.BSDF] = {}
    for name, scattering in (
        ("single bounce", ms.SingleBounce()),
        (f"unidirectional uncorrelated K={K}", ms.Unidirectional(ms.Uncorrelated(), K)),
        (f"unidirectional correlated K={K}", ms.Unidirectional(ms.Correlated(), K)),
        (f"unidirectional invariance K={K}", ms.Unidirectional(ms.Invariance(), K)),
        (f"bidirectional correlated K={K}", ms.Bidirectional(ms.Correlated(), K)),
        (f"bidirectional invariance K={K}", ms.Bidirectional(ms.Invariance(), K)),
        (f"height walk K={K}", ms.HeightWalk(K)),
    ):
        found[f"conductor F=1, {name}"] = ms.RoughConductor(ggx, Ideal(), scattering)
        if "invariance" in name:
            found[f"conductor F=1, Beckmann, {name}"] = ms.RoughConductor(ms.Beckmann(0.5), Ideal(), scattering)
            found[f"gold (3 channels), {name}"] = ms.RoughConductor(ggx, Conductor.metal("Au"), scattering)
        else:
            found[f"dielectric, {name}"] = ms.RoughDielectric(ggx, Dielectric(1.5), scattering)
        found[f"diffuse, {name}"] = ms.RoughDiffuse(ggx, 0.8, scattering)
    return found


def hemisphere(n: int, generator: torch.Generator) -> torch.Tensor:
    """Uniform directions above the horizon."""
    v = torch.randn(n, 3, generator=generator)
    v[:, 2] = v[:, 2].abs()
    return torch.nn.functional.normalize(v, dim=-1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--max-order", type=int, default=6)
    options = parser.parse_args()
    generator = torch.Generator().manual_seed(0)
    wi, wo = hemisphere(options.rows, generator), hemisphere(options.rows, generator)
    rows: list[dict[str, Any]] = []
    print(f"{'million a second':60} {'forward':>8} {'sample':>8} {'walk':>8}   (eager, {options.rows} rows, 1 path)")
    for name, bsdf in cases(options.max_order).items():
        calls = {
            "forward": lambda b=bsdf: b(wi, wo, b.uniforms((options.rows,))),
            "sample": lambda b=bsdf: b.sample(wi, b.uniforms((options.rows,))),
            "walk": lambda b=bsdf: b.sample_walk(wi, b.uniforms((options.rows,))),
        }
        with torch.no_grad():
            times = {what: seconds(call, repetitions=5) for what, call in calls.items()}
        rows.append({"case": name, "rows": options.rows, "seconds": times})
        speeds = "".join(f"{options.rows / times[what]['median'] / 1e6:9.2f}" for what in calls)
        print(f"{name:60}{speeds}")
    save("throughput", rows)


if __name__ == "__main__":
    main()
