"""The projected area of a GTR surface with one α and one γ, by a spline over the angle through the exact sums.

What the sums of gtr_area.py give is smooth in

    x² = ln(β² / α²) / ln(1 / α²),   β² = z² + α² ρ²,

which runs from 0 at the horizon to 1 at the pole, whatever α is (x → z for α → 1): the core of the distribution, of
width α, and its tail, of width 1, are both a fair part of it. The spline holds ln σ(−|w|) less that of GGX with the same α.
"""

from functools import lru_cache

import torch
from torch import Tensor

from torchms.distributions.gtr_area import downward_area, incidence
from torchms.maths.frame import Vec3
from torchms.maths.numerics import is_readable
from torchms.maths.ratios import exp_ratio, log_ratio
from torchms.maths.splines import interpolated, spline

NODES = 384
"""Angles that the sums are computed for."""
LAST = 1 - 2**-10
"""Largest x of a node: at 1 both areas are 0."""


def ggx_area(alpha2: Tensor, z: Tensor, rho2: Tensor) -> Tensor:
    """σ(−|w|) = (β − z) / 2 of γ = 2, without cancellation."""
    return 0.5 * alpha2 * rho2 / (torch.sqrt(z * z + alpha2 * rho2) + z)


def placed(alpha: Tensor, x: Tensor) -> tuple[Vec3, Tensor]:
    """The direction at x, upward, and L = −ln β²: the inverse of x, neither z nor ρ² by a difference."""
    b = (1 - alpha) * (1 + alpha)
    whole = log_ratio(-b, alpha * alpha)  # ln(1 / α²) / (1 − α²)
    x2 = x * x
    L = b * whole * (1 - x2)
    rho2 = whole * (1 - x2) * exp_ratio(-L)
    z = x * alpha * torch.sqrt(whole * exp_ratio(b * whole * x2))
    return Vec3(torch.sqrt(rho2), torch.zeros_like(x), z), L


def angle(alpha: Tensor, z: Tensor) -> Tensor:
    """x of z = |w_z|."""
    alpha2, b = alpha * alpha, (1 - alpha) * (1 + alpha)
    rise = z * z * (b / alpha2)
    return z * torch.sqrt(log_ratio(rise, 1 + rise) / log_ratio(-b, alpha2)) / alpha


def _coefficients(alpha: Tensor, gamma: Tensor) -> Tensor:
    node, _ = placed(alpha, torch.linspace(0, LAST, NODES, dtype=alpha.dtype, device=alpha.device))
    exact = downward_area(incidence(alpha, gamma, node))
    return spline(torch.log(exact / ggx_area(alpha * alpha, node.z, node.x * node.x)))


@lru_cache(maxsize=64)
def _remembered(alpha: float, gamma: float, dtype: torch.dtype) -> Tensor:
    """By the numbers themselves: a tensor may have changed since, whatever it says. Ordinary tensors in any mode."""
    with torch.inference_mode(False), torch.no_grad():
        return _coefficients(torch.tensor(alpha, dtype=dtype), torch.tensor(gamma, dtype=dtype))


def downward_area_by_spline(alpha: Tensor, gamma: Tensor, z: Tensor, rho2: Tensor) -> Tensor:
    """σ(−|w|) for z = |w_z|, ρ² = w_x² + w_y²; `alpha` and `gamma` have one element each."""
    alpha, gamma = alpha.reshape(()), gamma.reshape(())
    wanted = torch.is_grad_enabled() and (alpha.requires_grad or gamma.requires_grad)
    if not wanted and alpha.is_cpu and is_readable(alpha) and is_readable(gamma):
        coefficients = _remembered(float(alpha), float(gamma), alpha.dtype)
    else:
        coefficients = _coefficients(alpha, gamma)
    x = angle(alpha, z) * ((NODES - 1) / LAST)
    return ggx_area(alpha * alpha, z, rho2) * torch.exp(interpolated(coefficients, x))
