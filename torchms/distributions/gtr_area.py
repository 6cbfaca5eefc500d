"""The projected area σ(w) of a GTR surface, for any γ, as a trapezoidal sum that converges geometrically.

Integrated by parts, the Λ of [Dimov2015] Eq. 1 needs only Q(r), the share of the slopes that are steeper than r, which
is elementary. With r² = (τ² + z²) / ρ², z = |w_z| and ρ² = 1 − z²,

    σ(−|w|) = (1 / π) ∫_0^∞ Q(τ) τ² / (τ² + z²) dτ,   Q = (y^{1−γ} − 1) / (α^{2(1−γ)} − 1),
    y = (τ² + β²) / (τ² + 1),   β² = z² + α² ρ².

y runs from β² to 1. In the angle ϑ, with ln y = −ℓ (1 − cos ϑ) and ℓ = −ln β, Q is entire and the integrand is even
and periodic, so the midpoint sum over n angles in (0, π) errs by about e^{−2 n s}, s the half-width of the strip where it
is analytic. The one singularity that can come near, the pole at τ = ±i z, where Q = 1, is taken into account exactly.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.frame import Vec3
from torchms.maths.ratios import exp_ratio, log_ratio

NODES = {torch.float32: 20, torch.float64: 32}
"""Angles in (0, π). γ = 10 at α = 0.01 needs the most, as Q is a narrow peak there."""


class Incidence(NamedTuple):
    """One direction, and what of α and γ its integrals need."""

    z: Tensor  # |w_z|
    below: Tensor  # whether w_z < 0
    rho2: Tensor  # ρ² = w_x² + w_y²
    a: Tensor  # −ln α²
    k: Tensor  # 1 − γ
    ell: Tensor  # ℓ = −ln β
    share: Tensor  # ℓ / a, finite also at α = 1
    above: Tensor  # a − 2 ℓ = ln(β² / α²)
    p: Tensor  # sinh(η / 2) ρ / z, with the pole at ϑ = π ± i η


class Rings(NamedTuple):
    """Functions of the angle ϑ."""

    Q: Tensor
    slope: Tensor  # dQ/dϑ
    tau: Tensor
    f: Tensor  # Q τ² / (τ² + z²) |dτ/dϑ|


def incidence(alpha: Tensor, gamma: Tensor, w: Vec3, *others: Tensor) -> Incidence:
    """`w` seen on a surface of `alpha` and `gamma`, with as many axes as these and the `others` have at most."""
    # The integrals run over one more axis, in front.
    ndim = max(x.ndim for x in (alpha, gamma, *w, *others))
    w = Vec3(*(x.reshape((1,) * (ndim - x.ndim) + tuple(x.shape)) for x in w))
    below = w.z < 0
    # Not abs(): its gradient at the horizon is 0.
    z = torch.where(below, -w.z, w.z)
    rho2 = w.x * w.x + w.y * w.y
    b = (1 - alpha) * (1 + alpha)
    # β² = 1 − b ρ² = α² (1 + b z² / α²); a = −ln(1 − b).
    alpha2, z2 = alpha * alpha, z * z
    down = log_ratio(-b * rho2, z2 + alpha2 * rho2)
    rise = z2 * (b / alpha2)
    up = log_ratio(rise, 1 + rise)
    whole = log_ratio(-b, alpha2)
    # At the pole y = α²: cosh η − 1 = 2 sinh²(η/2) = (a − 2 ℓ) / ℓ.
    p = torch.sqrt(up / down) / alpha
    return Incidence(
        z, below, rho2, b * whole, 1 - gamma, 0.5 * b * rho2 * down, 0.5 * rho2 * down / whole, rise * up, p
    )


def rings(v: Incidence, half_sin: Tensor, half_cos: Tensor) -> Rings:
    """At the angles ϑ with sin(ϑ/2) = `half_sin` and cos(ϑ/2) = `half_cos`."""
    s2, c2 = half_sin * half_sin, half_cos * half_cos
    B, A = 2 * s2 * v.ell, 2 * c2 * v.ell
    below, above = exp_ratio(-A), exp_ratio(-B)
    # y = e^{−B}, y − β² = y A below and 1 − y = B above, so that τ² = (y − β²) / (1 − y).
    stem = torch.sqrt(torch.exp(-B) * below / above)
    # Q = (e^{−kB} − 1) / (e^{−ka} − 1), the exponentials divided so that none overflows.
    weight = v.share * torch.exp(v.k * (A + v.above)) / exp_ratio(v.k * v.a)
    tail = weight * exp_ratio(v.k * B)
    tau = stem * (half_cos / half_sin)
    tau2 = tau * tau
    jacobian = stem * exp_ratio(-2 * v.ell) / (below * above)
    return Rings(2 * s2 * tail, 2 * half_sin * half_cos * weight, tau, tail * jacobian * (tau2 / (tau2 + v.z * v.z)))


def stacked(values: list[float], like: Tensor) -> Tensor:
    """`values` along a new first axis before those of `like`."""
    return torch.tensor(values, dtype=like.dtype, device=like.device).reshape(-1, *(1,) * like.ndim)


def angles(n: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """sin(ϑ/2) and cos(ϑ/2) of the n midpoints of (0, π)."""
    halves = [math.pi * (j + 0.5) / (2 * n) for j in range(n)]
    return stacked([math.sin(h) for h in halves], like), stacked([math.cos(h) for h in halves], like)


def downward_area(v: Incidence) -> Tensor:
    """σ(−|w|) = σ(|w|) − |w_z|."""
    n = NODES[v.z.dtype]
    total = rings(v, *angles(n, v.ell)).f.sum(0) / n
    # A pole pair at ϑ = π ± i η with residue ± i z / 2 shifts the sum by z / (e^{2 n η} + 1);
    # e^{−η} = ρ² / (z p + √(ρ² + z² p²))².
    sinh = v.z * v.p
    root = sinh + torch.sqrt(v.rho2 + sinh * sinh)
    beyond = (v.rho2 / (root * root)) ** (2 * n)
    return total - v.z * (beyond / (1 + beyond))
