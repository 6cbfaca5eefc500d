"""The variables in which the single-bounce energies of all roughnesses are nearly polynomials.

Smith masking depends on the stretched direction s = (α_x x, α_y y, z) / r only, so that is what a table is over; what is
left of the azimuth are a few harmonics that vanish with the anisotropy q and at the pole:

    1 − E = p · Σ_l q^l Re((s_x + i s_y)^{2l}) · G_l(t, m, q²),   m = (α_x + α_y) / 2,   q = (α_x − α_y) / (α_x + α_y).

Exchanging x and y negates q and the odd harmonics, so the symmetry holds exactly; for α_x = α_y only l = 0 is left.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon, safe_sqrt

ALPHA = EllipticDistribution.limits
"""Range of the roughness."""
MOST_ANISOTROPIC = 0.999
"""Largest |q|: that of α = (2, 1e-3)."""
ETA = 3.0
"""Largest relative index of refraction, either way."""
SQUARE_ROOT = {"GGX": True, "Beckmann": False}
"""Whether the energy has a singularity at grazing incidence (like μ ln μ) that a root in t takes away."""


class Coordinates(NamedTuple):
    """Coordinates of a direction: t in [0, 1] from grazing to the pole, s_x, s_y, and p."""

    t: Tensor
    x: Tensor
    y: Tensor
    p: Tensor


def view(w: Vec3, ax: Tensor, ay: Tensor, square_root: bool) -> Coordinates:
    """Coordinates of `w`; below the horizon those of a grazing direction."""
    z = w.z.clamp_min(horizon(w.z.dtype))
    sx, sy = ax * w.x, ay * w.y
    rho2 = sx * sx + sy * sy
    inverse = 1 / torch.sqrt(rho2 + z * z)
    cos, sin2 = z * inverse, rho2 * inverse * inverse
    # 1 − √(1 − s_z), without cancellation: s_z / (1 + √(1 − s_z)) and 1 − s_z = (1 − s_z²) / (1 + s_z).
    t = cos / (1 + safe_sqrt(sin2 / (1 + cos)))
    m = (ax + ay) / 2
    # The energy lost is at most about sin² + m²: what a smooth surface loses goes to zero with it.
    p = (sin2 + m * m) / (1 + m * m)
    return Coordinates(safe_sqrt(t) if square_root else t, sx * inverse, sy * inverse, p)


def stretched_cosine(t: Tensor, square_root: bool) -> Tensor:
    """s_z at t: the inverse of `view`."""
    t = t * t if square_root else t
    return 1 - (1 - t) ** 2


def size_axis(m: Tensor) -> Tensor:
    """m / (1 + m), mapped to [−1, 1]."""
    low, high = (a / (1 + a) for a in ALPHA)
    return (2 * m / (1 + m) - (low + high)) / (high - low)


def size_at(x: Tensor) -> Tensor:
    """m at the coordinate x: the inverse of `size_axis`."""
    low, high = (a / (1 + a) for a in ALPHA)
    y = low + (high - low) * (x + 1) / 2
    return y / (1 - y)


def log_axis(m: Tensor) -> Tensor:
    """ln m, mapped to [−1, 1]: for means over all directions, which go to zero like a power of m."""
    low, high = (math.log(a) for a in ALPHA)
    return (2 * torch.log(m) - (low + high)) / (high - low)


def log_at(x: Tensor) -> Tensor:
    """m at the coordinate x: the inverse of `log_axis`."""
    low, high = (math.log(a) for a in ALPHA)
    return torch.exp(low + (high - low) * (x + 1) / 2)


def shape_axis(q: Tensor) -> Tensor:
    """q², mapped to [−1, 1]."""
    return 2 * (q / MOST_ANISOTROPIC) ** 2 - 1


def shape_at(x: Tensor) -> Tensor:
    """|q| at the coordinate x: the inverse of `shape_axis`."""
    return MOST_ANISOTROPIC * ((x + 1) / 2).clamp_min(0).sqrt()


def eta_axis(eta: Tensor) -> Tensor:
    """|ln η|, mapped to [−1, 1]."""
    return 2 * torch.log(eta).abs() / math.log(ETA) - 1


def eta_at(x: Tensor) -> Tensor:
    """η ≥ 1 at the coordinate x: the inverse of `eta_axis`."""
    return torch.exp(math.log(ETA) * (x + 1) / 2)
