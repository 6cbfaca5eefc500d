"""How noisy is a gradient, and is it right? Attached sampling beside held sampling, for every material and estimator.

Signal to noise is |mean gradient| over the standard deviation of one path's. Bias is the distance of the mean from that of
fourth-order differences with the same random numbers, relative to the slope, and z the largest of it in standard errors.
Both are of d/dα_x: of the value of all orders from the second on, and of the reflected albedo; root mean squares over three
pairs of directions. The albedo of glass (Beckmann, α = 0.2) has a large z without a bias: near the normal the differences
rest on the rare paths that reflect at one α and refract at the next, and their standard error on how many were met.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import torch
from record import save
from rich.console import Console
from rich.table import Table
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor, Dielectric

STEP = 0.08
"""Of the differences, relative to α_x. Of fourth order: those of second order are off by 10 % where a lobe is narrow."""
PAIRS = (((0.5, 0.3, 0.6), (-0.2, 0.6, 0.5)), ((0.1, 0.0, 0.9), (0.6, 0.3, 0.5)), ((0.8, 0.1, 0.3), (-0.5, 0.2, 0.7)))
"""wi and wo, to be normalised."""
ALPHAS = {"0.2": (0.2, 0.2), "0.5": (0.5, 0.5), "0.8, 0.4": (0.8, 0.4)}
MODES = {"attached": True, "held": False}

Estimator = Callable[[bool | None], ms.Scattering]


def cases(K: int) -> dict[str, tuple[Callable[[Any, ms.Scattering], ms.BSDF], dict[str, Estimator]]]:
    """Material → (its constructor, estimators by name)."""
    both: dict[str, Estimator] = {
        "unidirectional, invariance": lambda a: ms.Unidirectional(ms.Invariance(), K, a),
        "height walk": lambda a: ms.HeightWalk(K, a),
        "bidirectional, invariance": lambda a: ms.Bidirectional(ms.Invariance(), K, a),
    }
    glass: dict[str, Estimator] = {
        "unidirectional, correlated": lambda a: ms.Unidirectional(ms.Correlated(), K, a),
        "height walk": lambda a: ms.HeightWalk(K, a),
        "bidirectional, correlated": lambda a: ms.Bidirectional(ms.Correlated(), K, a),
    }
    return {
        "conductor": (lambda d, s: ms.RoughConductor(d, Conductor([0.2], [3.0]), s), both),
        "dielectric": (lambda d, s: ms.RoughDielectric(d, Dielectric(1.5), s), glass),
        "diffuse": (lambda d, s: ms.RoughDiffuse(d, 0.8, s), both),
    }


def directions() -> tuple[Tensor, Tensor]:
    wi, wo = torch.tensor(PAIRS, dtype=torch.float64).unbind(1)
    return torch.nn.functional.normalize(wi, dim=-1)[:, None], torch.nn.functional.normalize(wo, dim=-1)[:, None]


def quantity(name: str, surface: ms.BSDF, u: Tensor) -> Tensor:
    """(pairs, n): of every path."""
    wi, wo = directions()
    if name == "value":
        return surface.orders(wi, wo, u)[..., 1:, 0].sum(-1)
    return surface.albedo(wi, u).reflected[..., 0].sum(-1)


def measured(
    build: Callable[[Any, ms.Scattering], ms.BSDF],
    estimator: Estimator,
    distribution: Callable[..., Any],
    alpha: tuple[float, float],
    name: str,
    n: int,
) -> dict[str, float]:
    """Signal to noise of both modes, their bias, and the processor time of a path with its gradient [s], once."""
    shape = (len(PAIRS), n)
    row: dict[str, float] = {}

    def surface(ax: Tensor, attached: bool | None) -> ms.BSDF:
        ay = torch.full(shape, alpha[1], dtype=torch.float64)
        return build(distribution(ax, ay), estimator(attached)).to(torch.float64)

    start = torch.full(shape, alpha[0], dtype=torch.float64)
    u = surface(start, None).uniforms(shape, 1, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        at = {k: quantity(name, surface(start * (1 + k * STEP), None), u) for k in (-2, -1, 1, 2)}
    slope = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * STEP * alpha[0])

    def gradient(attached: bool | None) -> Tensor:
        leaf = start.clone().requires_grad_()
        return torch.autograd.grad(quantity(name, surface(leaf, attached), u).sum(), leaf)[0]

    for mode, attached in MODES.items():
        begun = time.process_time()
        g = gradient(attached)
        row[f"{mode} seconds"] = (time.process_time() - begun) / (n * len(PAIRS))
        mean = g.mean(1)
        row[f"{mode} snr"] = float((mean.square().mean() / g.var(1).mean()).sqrt())
        difference = g - slope
        # In units of its largest: the square of what a narrow lobe hardly reaches is no float64.
        unit = difference.abs().amax(1).clamp_min(torch.finfo(difference.dtype).tiny)
        error = unit * (difference / unit[:, None]).std(1) / n**0.5
        row[f"{mode} bias"] = float((difference.mean(1).square().mean() / slope.mean(1).square().mean()).sqrt())
        row[f"{mode} z"] = float((difference.mean(1) / error).nan_to_num().abs().max())
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", type=int, default=12_000)
    parser.add_argument("--max-order", type=int, default=4)
    parser.add_argument("--quick", action="store_true", help="few paths; nothing is saved")
    options = parser.parse_args()
    torch.set_num_threads(1)
    n = 2000 if options.quick else options.paths
    table = Table(title="d/dα_x, one path: signal to noise; relative bias (largest z)")
    for column in (
        "material",
        "distribution",
        "α",
        "of",
        "estimator",
        "attached",
        "held",
        "bias attached",
        "bias held",
    ):
        table.add_column(column, justify="right")
    rows = []
    for material, (build, estimators) in cases(options.max_order).items():
        for distribution in (ms.GGX, ms.Beckmann):
            for label, alpha in ALPHAS.items():
                for name in ("value", "albedo"):
                    for kind, estimator in estimators.items():
                        if name == "albedo" and "height" not in kind:
                            continue
                        if "bidirectional" in kind:
                            row = measured(build, estimator, distribution, alpha, name, max(500, n // 4))
                        else:
                            row = measured(build, estimator, distribution, alpha, name, n)
                        print(material, distribution.__name__, label, name, kind, flush=True)
                        rows.append(
                            {
                                "material": material,
                                "distribution": distribution.__name__,
                                "alpha": label,
                                "quantity": name,
                                "estimator": kind,
                                **row,
                            }
                        )
                        table.add_row(
                            *[str(v) for v in list(rows[-1].values())[:5]],
                            f"{row['attached snr']:.3f}",
                            f"{row['held snr']:.3f}",
                            *(f"{100 * row[f'{m} bias']:.1f} % ({row[f'{m} z']:.1f})" for m in MODES),
                        )
    Console(width=150).print(table)
    if not options.quick:
        save("gradients", rows)


if __name__ == "__main__":
    main()
