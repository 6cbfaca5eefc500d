"""G1 of GTR: the height fields of [Dimov2015], and how far its spline and our quadrature are from the integral.

Writes docs/figures/gtr_*.png and results/gtr.json. The truth is the integral of Λ over ln(r² / μ² − 1) in
20 000 steps of float64, in the source's own terms.
"""

import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import torch
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from record import save
from torch import Tensor

from torchms import GTR
from torchms.distributions.gtr_closed import CLOSED_FORMS, G1_spline

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
F64 = torch.float64


def G1(mu: Tensor, alpha: Tensor, gamma: Tensor, dtype: torch.dtype = F64) -> Tensor:
    """Ours, computed in `dtype`."""
    theta = torch.atan(1 / mu)
    w = torch.stack([torch.sin(theta), torch.zeros_like(theta), torch.cos(theta)], -1).to(dtype)
    return 1 / (1 + GTR(alpha.to(dtype), gamma.to(dtype)).Lambda(w).double())


def truth(mu: float, alpha: float, gamma: float) -> float:
    """G1 from (1/μ) ∫_μ^∞ P22(r²) 2 r (r sin φ_r − μ φ_r) dr, cos φ_r = μ / r."""
    t = torch.linspace(-30, 70, 20_001, dtype=F64)
    s = torch.exp(0.5 * t)
    r2, a2 = mu * mu * (1 + s * s), alpha * alpha
    scale = (gamma - 1) * (a2 - 1) / (math.pi * (1 - a2 ** (1 - gamma)))
    P22 = scale * torch.exp((gamma - 2) * torch.log1p(r2) - gamma * torch.log(r2 + a2))
    bow = torch.where(s < 0.03, s**3 * (1 / 3 - s * s / 5 + s**4 / 7), s - torch.atan(s))
    return 1 / (1 + float((P22 * bow * mu * mu * s * s).sum() * (t[1] - t[0])))


def errors() -> list[dict[str, Any]]:
    """|ΔG1| against the integral over α ∈ [0.01, 1], μ ∈ [1e-3, 10], γ ∈ (0, 10]: ours in both dtypes, and the spline."""
    generator = torch.Generator().manual_seed(20261122)
    n = 4000
    u = torch.rand(n, 3, generator=generator, dtype=F64)
    alpha, mu = 0.01 ** (1 - u[:, 0]) * 0.9999, 10 ** (4 * u[:, 1] - 3)
    gamma = 0.01 + 9.99 * u[:, 2]
    exact = torch.tensor([truth(*row) for row in torch.stack([mu, alpha, gamma], 1).tolist()], dtype=F64)
    low = gamma <= 4
    rows = []
    for name, values, where in (
        ("quadrature, float64", G1(mu, alpha, gamma), gamma > 0),
        ("quadrature, float32", G1(mu, alpha, gamma, torch.float32), gamma > 0),
        ("spline, γ ≤ 4", G1_spline(mu, alpha, gamma), low),
        ("spline clamped at 4, γ > 4", G1_spline(mu, alpha, gamma), ~low),
    ):
        error = (values - exact).abs()[where]
        rows.append({"what": name, "points": len(error), "mean": float(error.mean()), "max": float(error.max())})
        print(f"{name:28} mean {rows[-1]['mean']:.1e}  max {rows[-1]['max']:.1e}  ({len(error)} points)")
    return rows


def height_fields() -> None:
    """Section 4 of the source: G1 for γ = 0 … 4 over μ and α; section 6: |G1⁴ − G1¹⁰|."""
    figure, axes = plt.subplots(2, 3, figsize=(9, 5.4), layout="constrained")
    mu, alpha = torch.linspace(0.01, 5, 100, dtype=F64)[:, None], torch.linspace(0.1, 0.5, 60, dtype=F64)
    shades = Normalize(0, 1)
    for k, axis in enumerate(axes.flat[:5]):
        values = CLOSED_FORMS[k](mu, alpha).expand(100, 60)
        axis.pcolormesh(alpha, mu[:, 0], values, norm=shades, cmap="viridis", rasterized=True)
        axis.contour(alpha, mu[:, 0], values, levels=[0.8, 0.9, 0.95, 0.99, 0.999], colors="white", linewidths=0.7)
        axis.set(title=f"$G_1^{k}$", xlabel="α", ylabel="μ")
    figure.colorbar(ScalarMappable(shades, "viridis"), ax=axes[0, 2])
    mu, alpha = torch.linspace(0.01, 2, 100, dtype=F64)[:, None], torch.linspace(0.01, 1, 60, dtype=F64)
    far = (CLOSED_FORMS[4](mu, alpha) - G1(mu, alpha, torch.tensor(10.0, dtype=F64))).abs()
    mesh = axes.flat[5].pcolormesh(alpha, mu[:, 0], far, cmap="magma", rasterized=True)
    axes.flat[5].set(title=f"$|G_1^4 - G_1^{{10}}|$, at most {float(far.max()):.2f}", xlabel="α", ylabel="μ")
    figure.colorbar(mesh, ax=axes.flat[5])
    figure.savefig(FIGURES / "gtr_G1.png", dpi=80)


def error_maps() -> None:
    """Largest |ΔG1| over μ for each (α, γ): the spline, and float32 against float64 of ours."""
    mu = torch.logspace(-3, 1, 60, dtype=F64)[:, None, None]
    alpha, gamma = torch.logspace(-2, 0, 50, dtype=F64)[:, None], torch.linspace(0.05, 10, 100, dtype=F64)
    exact = G1(mu, alpha, gamma)
    maps = {
        "spline of the source (γ clamped at 4)": G1_spline(mu, alpha, gamma) - exact,
        "ours, float32": G1(mu, alpha, gamma, torch.float32) - exact,
    }
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for axis, (title, error) in zip(axes, maps.items(), strict=True):
        largest = error.abs().amax(0).clamp_min(1e-9).log10()
        mesh = axis.pcolormesh(gamma, alpha[:, 0], largest, cmap="inferno", rasterized=True)
        axis.set(title=title, xlabel="γ", ylabel="α", yscale="log")
        figure.colorbar(mesh, ax=axis, label="log10 of the largest error of G1")
    figure.savefig(FIGURES / "gtr_error.png", dpi=80)


def derivative() -> None:
    """∂G1/∂γ around γ = 1: ours by autograd in float32, the spline, and linear interpolation between the closed forms."""
    mu, alpha = torch.tensor(0.1, dtype=F64), torch.tensor(0.1, dtype=F64)
    gamma = torch.linspace(0.02, 2.5, 400, dtype=F64)
    curves = {}
    for name, dtype in (("integral, float64", F64), ("ours, float32", torch.float32)):
        x = gamma.to(dtype, copy=True).requires_grad_()
        (curves[name],) = torch.autograd.grad(G1(mu, alpha, x, dtype).sum(), x)
    x = gamma.clone().requires_grad_()
    (curves["spline"],) = torch.autograd.grad(G1_spline(mu, alpha, x).sum(), x)
    knots = torch.stack([form(mu, alpha) for form in CLOSED_FORMS])
    curves["linear"] = (knots[1:] - knots[:-1])[gamma.long()]
    figure, axis = plt.subplots(figsize=(6, 3.6), layout="constrained")
    styles = {"integral, float64": "k-", "ours, float32": "r--", "spline": "b-", "linear": "g:"}
    for name, values in curves.items():
        axis.plot(
            gamma, values.detach().double(), styles[name], label=name, linewidth=2.5 if name.startswith("int") else 1.3
        )
    axis.set(title="α = 0.1, μ = 0.1", xlabel="γ", ylabel="∂G1 / ∂γ")
    axis.legend()
    figure.savefig(FIGURES / "gtr_derivative.png", dpi=80)


def main() -> None:
    torch.set_num_threads(1)
    FIGURES.mkdir(exist_ok=True)
    height_fields()
    error_maps()
    derivative()
    save("gtr", errors())


if __name__ == "__main__":
    main()
