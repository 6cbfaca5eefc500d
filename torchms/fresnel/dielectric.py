"""Fresnel reflectance of the boundary between two transparent media."""

import torch
from torch import Tensor

from torchms.fresnel.base import from_front
from torchms.fresnel.interface import Interface
from torchms.maths.numerics import safe_div, safe_sqrt, smallest


def fresnel_dielectric(cos_i: Tensor, eta: Tensor) -> tuple[Tensor, Tensor]:
    """Kernel: unpolarised reflectance F [1] and cosine of refraction; cos_i ≥ 0, eta = n_transmitted / n_incident.

    Component-wise, no channel axis; the two broadcast. F ≤ 1 up to rounding and cos_t ≥ 0. Under total internal
    reflection F is exactly 1, cos_t exactly 0, and both have zero gradients. eta = 1 reflects nothing, at grazing
    incidence too.
    """
    # [Walter2007] Eq. 22 with g = η cos θ_t, so g² = η² − 1 + c². Its two amplitudes,
    #   r_s = (g − c) / (g + c),   r_p = r_s (c (g + c) − 1) / (c (g − c) + 1),
    # lose digits for η near 1. Multiply r_s by (g + c) / (g + c) and put c² = 1 − s² in the second factor:
    #   r_s = (η² − 1) / (g + c)²,   r_p = r_s (c g − s²) / (c g + s²).
    c2 = cos_i * cos_i
    s2 = (1 - cos_i) * (1 + cos_i)
    x = (eta - 1) * (eta + 1)
    g2 = torch.where(2 * c2 < 1, x + c2, eta * eta - s2)  # the one digit-saving near grazing, the other near normal
    total = (g2 <= smallest(g2.dtype)) & (eta < 1)
    g = safe_sqrt(g2)
    sum_ = torch.where(total, 1.0, g + cos_i)
    r_s = safe_div(x, sum_ * sum_)  # 0 / 0 only for η = 1 at grazing incidence, where the limit along c is 0
    cg = cos_i * g
    ratio = safe_div(cg - s2, cg + s2)  # c g + s² is η at normal incidence, and s² > η² where g = 0
    return torch.where(total, 1.0, r_s * r_s * (1 + ratio * ratio) / 2), g / eta


def transmittance(c: Tensor, g: Tensor, eta: Tensor) -> Tensor:
    """1 − F from c = cos θ_i and g = η cos θ_t, both at least 0, without the cancellation near total reflection.

    [Walter2007] Eq. 22 in its two polarisations, 1 − r² with r_s = (c − g) / (c + g), r_p = (η² c − g) / (η² c + g).
    """
    c, g = c.clamp_min(0), g.clamp_min(0)
    s, p = c + g, eta * eta * c + g
    return 2 * c * g * (safe_div(torch.ones_like(s), s * s) + safe_div(eta * eta, p * p))


class Dielectric(Interface):
    """Reflectance of a smooth boundary between two transparent media [1], one channel; 1 − F is transmitted.

    `eta` = n_inside / n_outside, in [1e-6, 1e6], is a number or has shape (*batch). The sign of cos θ tells the side
    that the light comes from: outside where cos θ ≥ 0, inside (relative index 1 / eta) where cos θ < 0. Total internal
    reflection is exactly 1. Raises ValueError for eta out of range or NaN. Source: Fresnel's equations in the form of
    [Walter2007] Eq. 22.
    """

    eta: Tensor

    def __init__(self, eta: float | Tensor) -> None:
        super().__init__()
        self.declare(
            "eta",
            eta,
            low=1e-6,
            high=1e6,
            remedy="It is n_inside / n_outside: 1.5 for glass in air, 1 / 1.5 for an air bubble in glass.",
        )

    @property
    def n_channels(self) -> int:
        """1: the index has no spectral axis."""
        return 1

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        """Kernel: (1, *any) for signed cosines (*any)."""
        F, _ = fresnel_dielectric(from_front(cos_theta), self.relative_eta(cos_theta))
        return F.unsqueeze(0)

    def transmittance(self, cos_theta: Tensor, cos_t: Tensor) -> Tensor:
        eta = self.relative_eta(cos_theta)
        return transmittance(from_front(cos_theta), eta * cos_t, eta).unsqueeze(0)
