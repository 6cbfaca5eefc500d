"""Fresnel reflectance of a metal: complex index of refraction, real arithmetic."""

import torch
from torch import Tensor

from torchms.fresnel.base import Fresnel, from_front
from torchms.fresnel.metals import lookup
from torchms.maths.numerics import safe_sqrt, smallest
from torchms.parameters.declared import Value, channels_first


def fresnel_conductor(cos_i: Tensor, eta: Tensor, k: Tensor) -> Tensor:
    """Kernel: unpolarised reflectance F [1] of a medium of index eta + i k, relative to that of the incident side.

    cos_i ≥ 0; component-wise, all three broadcast.
    """
    # Fresnel's equations hold with a complex index N = η + i k (Born and Wolf, Principles of Optics, 7th ed., sections
    # 1.5.2 and 14.2). With c = cos θ_i, s² = 1 − c² and N cos θ_t = √(N² − s²) = a + i b they read
    #   r_s = (c − (a + ib)) / (c + (a + ib)),   r_p = r_s ((a + ib) c − s²) / ((a + ib) c + s²),
    # and the squared moduli are
    #   R_s = ((a − c)² + b²) / ((a + c)² + b²),
    #   R_p = R_s ((ac − s²)² + b²c²) / ((ac + s²)² + b²c²) = R_s (1 − 4 a c s² / ((ac + s²)² + b²c²)).
    # Squaring a + ib: a² − b² = t := η² − k² − s² and a b = η k, so a² + b² = q := √(t² + 4 η² k²), a² = (q + t) / 2,
    # b² = (q − t) / 2. Take the one whose sum does not cancel (b for most metals), the other from a b = η k.
    c2 = cos_i * cos_i
    s2 = (1 - cos_i) * (1 + cos_i)
    # η² − s² in two ways: the one digit-saving near grazing, the other near normal incidence.
    t = torch.where(2 * c2 < 1, (eta - 1) * (eta + 1) + c2, eta * eta - s2) - k * k
    eta_k = eta * k
    above = t >= 0
    # (t² underflows in float32 for |t| < 1e-15 only: for N = 1, no boundary at all, within 3e-8 of grazing incidence.)
    q = safe_sqrt(t * t + 4 * eta_k * eta_k)
    larger2 = (q + torch.where(above, t, -t)) / 2  # not t.abs(): its derivative at t = 0 would be wrong
    # The larger is larger2 / √larger2, the other η k / √larger2.
    inverse = 1 / torch.sqrt(larger2.clamp_min(smallest(larger2.dtype)))
    a = inverse * torch.where(above, larger2, eta_k)
    b = inverse * torch.where(above, eta_k, larger2)

    b2 = b * b
    minus, plus = a - cos_i, a + cos_i
    ac = a * cos_i
    ac_s2 = ac + s2
    below = ac_s2 * ac_s2 + b2 * c2
    # R_s times the bracket of R_p, as one quotient.
    over, under = (minus * minus + b2) * (below - 2 * (ac * s2)), (plus * plus + b2) * below
    # 0 / 0 for N = 1 at grazing incidence, where the limit is 0, and for N → 0 at normal incidence, where it is 1.
    least = smallest(under.dtype) ** 0.5
    return (over + least * c2) / (under + least)


class Conductor(Fresnel):
    """Reflectance of a smooth metal [1], exact and unpolarised.

    `eta` > 0 and `k` ≥ 0, the real and imaginary part of the index of refraction relative to the outside, are numbers
    or have shape (*batch, C); they broadcast. The sign of cos θ does not matter. Raises ValueError for values out of
    range (neither may exceed 1e6) and for shapes that do not broadcast. Source: Fresnel's equations with a complex
    index, Born and Wolf, Principles of Optics, 7th ed., section 14.2.
    """

    eta: Tensor
    k: Tensor

    def __init__(self, eta: Value, k: Value) -> None:
        super().__init__()
        remedy = "Conductor.metal(name) has measured values, for example Conductor.metal('Cu')."
        self.declare("eta", eta, low=0.0, high=1e6, open_low=True, channels=True, remedy=remedy)
        self.declare("k", k, low=0.0, high=1e6, channels=True, remedy=remedy)
        try:
            torch.broadcast_shapes(self.eta.shape, self.k.shape)
        except RuntimeError as error:
            raise ValueError(
                f"Conductor(eta=..., k=...) must broadcast; got shapes {tuple(self.eta.shape)} and "
                f"{tuple(self.k.shape)}. Give both as numbers or as (*batch, C) with the same C."
            ) from error

    @classmethod
    def metal(cls, name: str) -> "Conductor":
        """The metal `name` in three channels, linear sRGB (Rec. 709 primaries): a chemical symbol or an English name.

        Letter case is ignored. eta and k are those whose reflectance follows, over the angle, the measured spectra
        integrated to RGB under illuminant D65; `metals.json` beside this file has sources and residuals. Raises
        ValueError, listing the known names, for any other.
        """
        eta, k = lookup(name)
        return cls(eta, k)

    @property
    def n_channels(self) -> int:
        """Number of channels of eta and k together."""
        return max(self.eta.shape[-1], self.k.shape[-1])

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        """Kernel: (C, *any) for cosines (*any)."""
        eta = channels_first(self.eta, cos_theta.ndim)
        k = channels_first(self.k, cos_theta.ndim)
        return fresnel_conductor(from_front(cos_theta), eta, k)
