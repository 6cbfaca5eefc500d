"""Distant shadowing and masking on the full sphere [Wang2022, Eqs. 3, 12, 17].

The kernels take a = a(w) = |1 + Λ(w)| of the view direction and `lam` = Λ(d) ≥ 0 of a direction that leaves upward,
and return probabilities: the masking terms multiplied by a(w).
"""

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import split
from torchms.maths.numerics import expm1, safe_div, smallest
from torchms.maths.special import log_beta_step
from torchms.typing import Direction, Scalar


def escape_uncorrelated(lam: Tensor) -> Tensor:
    """Probability 1 / (1 + Λ(d)) that an upgoing ray leaves, whatever the height it starts from."""
    return 1 / (1 + lam)


def escape_correlated(a: Tensor, lam: Tensor) -> Tensor:
    """Probability a(w) / (a(w) + Λ(d)) that a ray reflected upward leaves: a(w) · G2_dist [Wang2022, Eq. 12]."""
    return safe_div(a, a + lam)


def escape_transmitted(a: Tensor, lam: Tensor) -> Tensor:
    """Probability a(w) · B(a(w), 1 + Λ(d)) = Γ(a+1) Γ(Λ+1) / Γ(a+Λ+1) that a refracted ray leaves on its new side.

    B is the Beta function; the height is U for the ray that arrives and 1 − U for the one that leaves.
    """
    return torch.exp(log_beta_step(a, lam))


def area_of(distribution: MicrofacetDistribution, w: Direction) -> Scalar:
    """a(w) = |1 + Λ(w)|; kept above zero, which Beckmann's underflows to for steep directions from below."""
    a = distribution.blocking(-split(w))
    return a.clamp_min(smallest(a.dtype))


def G1_dist(distribution: MicrofacetDistribution, w: Direction) -> Scalar:
    """Distant masking 1 / |1 + Λ(w)| of `w` on the full sphere [Wang2022, Eq. 3]; above 1 below the horizon."""
    return 1 / area_of(distribution, w)


def G2_dist(distribution: MicrofacetDistribution, w: Direction, d: Direction, transmitted: bool = False) -> Scalar:
    """Probability density of arriving along −w and leaving along d at the last bounce [Wang2022, Eq. 12].

    G2_dist = 1 / (a(w) + Λ(d)) for `d` above the horizon, else 0. With `transmitted`, `d` leaves on the other side of
    the surface (d_z < 0) and G2_dist = B(a(w), 1 + Λ(−d)).
    """
    a = area_of(distribution, w)
    leaving = -split(d) if transmitted else split(d)
    lam = distribution.blocking(leaving)
    value = escape_transmitted(a, lam) / a if transmitted else 1 / (a + lam)
    return torch.where(leaving.z > 0, value, 0.0)


def G2_mid(distribution: MicrofacetDistribution, w: Direction, d: Direction, transmitted: bool = False) -> Scalar:
    """The same, of arriving along −w and being blocked along d: G1_dist(w) − G2_dist(w, d) [Wang2022, Eq. 17]."""
    a = area_of(distribution, w)
    leaving = -split(d) if transmitted else split(d)
    lam = distribution.blocking(leaving)
    # 1 − a / (a + Λ) and 1 − a B(a, 1 + Λ), without cancellation.
    stays = -expm1(log_beta_step(a, lam)) if transmitted else lam / (a + lam)
    return torch.where(leaving.z > 0, stays, 1.0) / a
