"""How noisy is one path? Variance of the bidirectional estimator over that of the others, at random directions.

The ratio is of the variances of one path each. A bidirectional path is several pairs of walks, so it takes longer: the
last column multiplies the ratio by that of the times (one thread), which is how the error at equal time compares.
"""

import argparse
from typing import Any

import torch
from record import save, seconds
from torch import Tensor

import torchms as ms
from torchms.estimators.path_tracer import PathTracer
from torchms.fresnel import Dielectric, Ideal
from torchms.maths.numerics import log1p
from torchms.paths.height import HeightState, RandomHeight
from torchms.paths.segments import Leg
from torchms.sampling.stream import Stream

ALPHAS = {"0.25": (0.25,), "0.5": (0.5,), "1": (1.0,), "1,0.1": (1.0, 0.1)}


class AnalogHeight(RandomHeight):
    """The heights of [Heitz2016] as printed there: a ray that escapes ends."""

    def extend(self, state: HeightState, leg: Leg) -> HeightState:
        # U' = U (1 − u)^(−1 / Λ); beyond 1 the ray has left the surface.
        (number,) = leg.numbers
        step = log1p(-number) / leg.lam.clamp_min(1e-12)
        log_U = self._on_side_of(leg, state.log_U) + torch.where(leg.up, -step, step)
        return HeightState(state.stay * (log_U <= 0), log_U.clamp_max(0.0))


class AnalogWalk(PathTracer):
    """The walk of [Heitz2016] that ends at random, with next-event estimation."""

    is_unbiased = True
    is_reciprocal = True

    def __init__(self, max_order: int) -> None:
        super().__init__(AnalogHeight(), max_order)


def materials(alpha: tuple[float, ...]) -> dict[str, Any]:
    """Name → (BSDF of a scattering, segment, K)."""
    return {
        "conductor F=1": (lambda s: ms.RoughConductor(ms.GGX(*alpha), Ideal(), s), ms.Invariance, 10),
        "conductor F=1, Beckmann": (lambda s: ms.RoughConductor(ms.Beckmann(*alpha), Ideal(), s), ms.Invariance, 10),
        "diffuse, albedo 1": (lambda s: ms.RoughDiffuse(ms.GGX(*alpha), 1.0, s), ms.Invariance, 6),
        "conductor F=1, correlated": (lambda s: ms.RoughConductor(ms.GGX(*alpha), Ideal(), s), ms.Correlated, 10),
        "glass, correlated": (lambda s: ms.RoughDielectric(ms.GGX(*alpha), Dielectric(1.5), s), ms.Correlated, 6),
    }


def pairs(n: int, both_sides: bool) -> tuple[Tensor, Tensor]:
    """`n` pairs of directions, uniform over the hemisphere (or the sphere)."""
    generator = torch.Generator().manual_seed(1)
    z = torch.rand(2, n, generator=generator)
    phi = 2 * torch.pi * torch.rand(2, n, generator=generator)
    if both_sides:
        z = z * torch.where(torch.rand(2, n, generator=generator) < 0.5, -1.0, 1.0)
    r = (1 - z * z).sqrt()
    wi, wo = torch.stack([r * phi.cos(), r * phi.sin(), z], -1)
    return wi, wo


def variance_and_time(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, n: int) -> tuple[Tensor, Tensor, float]:
    """Variance of one path at each pair, mean over the channels; whether it is known; the time of one path [s].

    Known: no single path makes up a tenth of it. Otherwise more of those that matter may not have occurred.
    """
    total = square = torch.zeros(len(wi), 1, dtype=torch.float64)
    largest = torch.zeros(len(wi), dtype=torch.float64)
    size = 4000
    blocks = max(1, n // size)
    n = blocks * size
    for block in range(blocks):
        u = Stream(torch.arange(len(wi) * size).reshape(len(wi), size) + ((block + 1) << 32))
        value = bsdf(wi[:, None], wo[:, None], u).double().mean(-1, keepdim=True)
        largest = torch.maximum(largest, value.amax((1, 2)))
        total, square = total + value.sum(1), square + (value * value).sum(1)
    variance = (square / n - (total / n) ** 2)[:, 0]
    known = (largest - total[:, 0] / n) ** 2 < 0.1 * n * variance
    rows, u = wi.repeat(8192 // len(wi), 1), bsdf.uniforms((8192 // len(wi) * len(wi),))
    there = wo.repeat(8192 // len(wi), 1)
    return variance, known, seconds(lambda: bsdf(rows, there, u))["median"] / len(rows)


def geometric(ratio: Tensor) -> float | None:
    """Geometric mean over the pairs where anything was seen; None if that is none of them."""
    good = (ratio > 0) & ratio.isfinite()
    return float(ratio[good].log().mean().exp()) if bool(good.any()) else None


def cell(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


@torch.no_grad()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--paths", type=int, default=16_000)
    parser.add_argument("--quick", action="store_true", help="few paths, nothing is saved")
    options = parser.parse_args()
    n = 4000 if options.quick else options.paths
    torch.set_num_threads(1)
    rows: list[dict[str, Any]] = []
    print("variance of one bidirectional path over that of one path of ..., geometric mean over the pairs")
    print("cos >= 0.2: of the pairs with both directions that far above the horizon; known: pairs where no single path")
    print("makes up a tenth of a variance, and the mean over them; x time: all pairs, at equal time")
    head = ("material", "alpha", "K", "other", "all pairs", "cos >= 0.2", "known", "of them", "x time")
    widths = (26, 6, 3, 16, 10, 11, 6, 8, 8)
    print("  ".join(h.rjust(w) for h, w in zip(head, widths, strict=True)))
    for label, alpha in ALPHAS.items():
        for name, (build, segment, K) in materials(alpha).items():
            wi, wo = pairs(options.pairs, "glass" in name)
            others: dict[str, ms.Scattering] = {"unidirectional": ms.Unidirectional(segment(), K)}
            if segment is ms.Invariance:
                others |= {"height walk": ms.HeightWalk(K), "analog walk": AnalogWalk(K)}
            ours, known, time = variance_and_time(build(ms.Bidirectional(segment(), K)), wi, wo, n // 4)
            high = (wi[:, 2].abs() >= 0.2) & (wo[:, 2].abs() >= 0.2)
            for other, scattering in others.items():
                theirs, also_known, their_time = variance_and_time(build(scattering), wi, wo, n)
                both = known & also_known
                ratio = ours / theirs
                row = {
                    "material": name,
                    "alpha": list(alpha),
                    "max_order": K,
                    "other": other,
                    "pairs": len(ratio),
                    "paths": n,
                    "variance_ratio": geometric(ratio),
                    "variance_ratio_of_known": geometric(ratio[both]),
                    "pairs_known": int(both.sum()),
                    "variance_ratio_cos_above_0.2": geometric(ratio[high]),
                    "pairs_cos_above_0.2": int(high.sum()),
                    "time_ratio": time / their_time,
                    "variance_times_time_ratio": geometric(ratio * (time / their_time)),
                }
                rows.append(row)
                cells = (
                    name,
                    label,
                    K,
                    other,
                    *(cell(row[k], 3) for k in ("variance_ratio", "variance_ratio_cos_above_0.2")),
                    row["pairs_known"],
                    cell(row["variance_ratio_of_known"], 3),
                )
                cells = (*cells, cell(row["variance_times_time_ratio"], 2))
                print("  ".join(str(c).rjust(w) for c, w in zip(cells, widths, strict=True)), flush=True)
    if not options.quick:
        save("variance", rows)


if __name__ == "__main__":
    main()
