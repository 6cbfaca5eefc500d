"""Bounded visible normals [Tokuyoshi2023] against the spherical caps of [Dupuy2023], for GGX reflection.

Share of reflections below the horizon over α × θ, variance of one sample of the single-bounce furnace (F = 1), and Fig. 1 of
the supplement. Writes docs/figures/bounded_*.png and results/bounded_normals.json.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import torch
from record import save
from torch import Tensor

from torchms import GGX
from torchms.maths.frame import direction, normalized, split

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
F64 = torch.float64
ALPHAS = [(0.1,), (0.25,), (0.5,), (0.75,), (1.0,), (0.2, 0.9), (0.05, 0.5)]
THETAS = [0, 15, 30, 45, 60, 75, 85, 89]
CURVES = [((0.5,), 30), ((0.5,), 75), ((0.2, 0.9), 30), ((0.2, 0.9), 75), ((1.0,), 60), ((0.05, 0.5), 60)]


def ggx(alpha: tuple[float, ...]) -> GGX:
    return GGX(*(torch.tensor(a, dtype=F64) for a in alpha))


def incident(degrees: float, phi: float = 0.7) -> Tensor:
    return direction(math.radians(degrees), phi)


def row(alpha: tuple[float, ...], degrees: float, u: Tensor) -> dict[str, Any]:
    """What both samplers lose, and the variance of G2 D / (4 w_z p), whose mean is the energy of one bounce."""
    surface, w = ggx(alpha), incident(degrees)
    out: dict[str, Any] = {"alpha": list(alpha), "theta_degrees": degrees, "samples": len(u)}
    for name, sample, density in (
        ("caps", surface.sample_visible, surface.D_visible),
        ("bounded", surface.sample_bounded, surface.D_bounded),
    ):
        m = sample(w, u)
        wo = 2 * (m @ w)[:, None] * m - w
        up = wo[:, 2] > 0
        G2 = 1 / (1 + surface.Lambda(w) + surface.Lambda(wo).clamp_min(0))
        # value / pdf: [D G2 / (4 w_z)] / [density / (4 ⟨w, m⟩)].
        estimate = torch.where(up, surface.D(m) * G2 * (m @ w) / (w[2] * density(w, m)), 0.0)
        out[f"{name}_rejected"] = 1 - float(up.double().mean())
        out[f"{name}_energy"] = float(estimate.mean())
        out[f"{name}_variance"] = float(estimate.var())
    return out


def heat_map(rows: list[dict[str, Any]]) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    labels = [", ".join(map(str, a)) for a in ALPHAS]

    def grid(value) -> Tensor:
        return torch.tensor([value(r) for r in rows], dtype=F64).reshape(len(ALPHAS), len(THETAS))

    panels = {
        "rejected by spherical caps [%]": (grid(lambda r: 100 * r["caps_rejected"]), "viridis", 60, "{:.1f}"),
        "rejected with the bound [%]": (grid(lambda r: 100 * r["bounded_rejected"]), "viridis", 60, "{:.1f}"),
        "variance, bounded / caps": (
            grid(lambda r: r["bounded_variance"] / r["caps_variance"]),
            "RdYlGn_r",
            2,
            "{:.2f}",
        ),
    }
    for axis, (title, (values, colors, top, form)) in zip(axes, panels.items(), strict=True):
        axis.imshow(values, cmap=colors, vmin=0, vmax=top, aspect="auto")
        ink = "white" if colors == "viridis" else "black"
        for i, j in torch.cartesian_prod(torch.arange(len(ALPHAS)), torch.arange(len(THETAS))).tolist():
            axis.text(j, i, form.format(float(values[i, j])), ha="center", va="center", fontsize=6, color=ink)
        axis.set(title=title, xlabel="θ of i [°]", ylabel="α")
        axis.set_xticks(range(len(THETAS)), [str(t) for t in THETAS])
        axis.set_yticks(range(len(ALPHAS)), labels)
    figure.savefig(FIGURES / "bounded_normals.png", dpi=90)


def supplement() -> None:
    """Fig. 1: δ_z of the old cap, of the bounded cap and of the reflection bound against longitude."""
    figure, axes = plt.subplots(2, 3, figsize=(10, 5.2), layout="constrained", sharex=True)
    phi = torch.linspace(-math.pi, math.pi, 721, dtype=F64)
    for axis, (alpha, degrees) in zip(axes.flat, CURVES, strict=True):
        surface, w = ggx(alpha), incident(degrees)
        s = normalized(surface.stretched(split(w)))
        old, new = float(-s.z), float(-surface.bound(split(w)) * s.z)
        bound = surface.horizon_bound(split(w), phi)
        assert float(bound.min()) >= new - 1e-12 and new >= old
        axis.axhline(old, color="green", linestyle="--", label="spherical cap")
        axis.axhline(new, color="red", label="bounded cap")
        axis.plot(phi, bound, color="orange", label="reflections on the horizon")
        axis.set(title=f"α = {', '.join(map(str, alpha))}; θ = {degrees}°", ylim=(-1.05, 1.05))
    for axis in axes[1]:
        axis.set_xlabel("longitude of the reflection φ")
    for axis in axes[:, 0]:
        axis.set_ylabel("δ_z")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(FIGURES / "bounded_cap.png", dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=200_000)
    options = parser.parse_args()
    torch.set_num_threads(1)
    FIGURES.mkdir(exist_ok=True)
    supplement()
    u = torch.rand(options.samples, 2, generator=torch.Generator().manual_seed(20261122), dtype=F64)
    rows = [row(alpha, theta, u) for alpha in ALPHAS for theta in THETAS]
    for r in rows:
        print(
            f"alpha {r['alpha']!s:12} theta {r['theta_degrees']:2}: rejected {r['caps_rejected']:.4f} -> "
            f"{r['bounded_rejected']:.4f}, variance {r['caps_variance']:.2e} -> {r['bounded_variance']:.2e}"
        )
    heat_map(rows)
    save("bounded_normals", rows)


if __name__ == "__main__":
    main()
