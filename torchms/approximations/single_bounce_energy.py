"""Energy that one bounce loses, by quadrature over the slopes of the facets: what the tables are made of.

Facets that reflect `wi` above the horizon are a disc in the plane of slopes, of radius 1 / μ about −tan θ in the azimuth
of wi: 2 (w·m) m_z > μ. It holds the slope 0, so in polar coordinates about that the disc has one edge at every azimuth,
and the integrand D_w(m) · a / (a + Λ(o)) has no kink inside.
"""

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from torchms.distributions import GGX, Beckmann
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, reflect, split
from torchms.paths.masking import escape_correlated

SLOPES_AT_ONCE = 1 << 20
"""Slopes that are evaluated at a time."""


def gauss(n: int) -> tuple[Tensor, Tensor]:
    """Nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return torch.from_numpy((x + 1) / 2), torch.from_numpy(w / 2)


def crowded(n: int) -> tuple[Tensor, Tensor]:
    """Nodes and weights on [0, 1] that crowd towards both ends."""
    x, w = gauss(n)
    return x * x * (3 - 2 * x), 6 * x * (1 - x) * w


def with_alphas(kind: type[EllipticDistribution], ax: Tensor, ay: Tensor) -> EllipticDistribution:
    """A distribution whose roughnesses may be outside of the range that a user is allowed: nodes of the tables are."""
    distribution = kind(1.0, 1.0)
    distribution.alpha, distribution.alpha_y = ax, ay
    return distribution


def _angle(distribution: EllipticDistribution, r: Tensor) -> Tensor:
    """The radial variable at the stretched slope r: smooth, and bounded (Beckmann's beyond 6.5 hold e^−42)."""
    return torch.atan(r) if isinstance(distribution, GGX) else r.clamp_max(6.5)


def _radius(distribution: EllipticDistribution, v: Tensor) -> tuple[Tensor, Tensor]:
    """r at the radial variable v, and density 2 r h(r) dr / dv of the stretched slopes."""
    if isinstance(distribution, GGX):
        return torch.tan(v), torch.sin(2 * v)
    if isinstance(distribution, Beckmann):
        return v, 2 * v * torch.exp(-v * v)
    raise TypeError(f"there is no quadrature for {type(distribution).__name__}.")


@torch.no_grad()
def energy_lost(
    kind: type[EllipticDistribution], wi: Tensor, ax: Tensor, ay: Tensor, n_azimuth: int = 64, n_radius: int = 24
) -> Tensor:
    """1 − E of one bounce off facets with F = 1; wi (n, 3), ax and ay (n), float64."""
    return 1 - energy(kind, wi, ax, ay, n_azimuth, n_radius)


@torch.no_grad()
def energy(
    kind: type[EllipticDistribution],
    wi: Tensor,
    ax: Tensor,
    ay: Tensor,
    n_azimuth: int = 64,
    n_radius: int = 24,
    reflectance: Callable[[Tensor], Tensor] | None = None,
) -> Tensor:
    """E of one bounce; wi (n, 3), ax and ay (n), float64. reflectance: of facets, by the cosine; None for F = 1."""
    step = max(1, SLOPES_AT_ONCE // (2 * n_azimuth))
    parts = []
    for rows in torch.arange(len(wi)).split(step):
        distribution = with_alphas(kind, ax[rows], ay[rows])
        parts.append(_energy(distribution, split(wi[rows]), n_azimuth, n_radius, reflectance))
    return torch.cat(parts)


def _energy(
    distribution: EllipticDistribution,
    w: Vec3,
    n_azimuth: int,
    n_radius: int,
    reflectance: Callable[[Tensor], Tensor] | None,
) -> Tensor:
    x, weight = crowded(n_azimuth)
    ax, ay = distribution.alphas
    # Two halves, which meet where the slope is across the direction of incidence: c = 0.
    turn = torch.cat([x, x + 1])[:, None] * math.pi + torch.atan2(-ax * w.x, ay * w.y)
    vx, vy = ax * torch.cos(turn), ay * torch.sin(turn)
    c, length2 = vx * w.x + vy * w.y, (vx * vx + vy * vy) * w.z
    # The edge of the disc: r² |v|² μ + 2 r c = μ.
    root = torch.sqrt(c * c + length2 * w.z)
    ahead = c > 0
    edge = _angle(distribution, torch.where(ahead, w.z / torch.where(ahead, c + root, 1.0), (root - c) / length2))
    area, a = distribution.projected_area(w), distribution.blocking(-w)
    total = torch.zeros_like(edge)
    for v, radial_weight in zip(*(values.tolist() for values in crowded(n_radius)), strict=True):
        r, density = _radius(distribution, edge * v)
        p, q = r * vx, r * vy
        inverse = 1 / torch.sqrt(1 + p * p + q * q)
        d = reflect(w, Vec3(-p * inverse, -q * inverse, inverse))
        facing = (w.z - p * w.x - q * w.y).clamp_min(0)
        if reflectance is not None:
            density = density * reflectance(facing * inverse)
        facing = facing / area
        escapes = torch.where(d.z > 0, escape_correlated(a, distribution.blocking(d)), 0.0)
        total = total + (radial_weight * edge) * density * facing * escapes
    return (total * weight.repeat(2)[:, None]).sum(0) / 2
