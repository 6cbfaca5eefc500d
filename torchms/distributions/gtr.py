"""The generalised Trowbridge–Reitz distribution."""

import math

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.distributions.gtr_area import downward_area, incidence
from torchms.distributions.gtr_spline import downward_area_by_spline
from torchms.distributions.gtr_visible import visible_normal
from torchms.maths.frame import Vec3
from torchms.maths.numerics import is_recorded
from torchms.maths.ratios import exp_ratio


class GTR(MicrofacetDistribution):
    """GTR normals [Burley2012]: D ∝ (1 + (α² − 1) cos²θ)^−γ, isotropic; γ = 2 is GGX, lesser γ has longer tails.

    `alpha`: roughness in [0.01, 1]; `gamma`: in (0, 10]. Float, tensor or per-pixel map (*batch), buffer or
    `nn.Parameter`. All of Λ, G1 and the visible normals are those of this γ: sums that converge geometrically, at every
    direction in float64, compiled and for maps of α or γ. Eager and in ONNX, in float32 with one α and one γ, the sums are
    taken at 384 angles and a spline goes through them: |ΔG1| < 1e-6, |ΔΛ| / Λ < 3e-5, at a twentieth of the cost.
    Raises ValueError outside the ranges.
    """

    sources = ("Burley2012", "Dimov2015")
    most_at_once = 1 << 14  # each of them takes the terms of a sum

    alpha: Tensor
    gamma: Tensor

    def __init__(self, alpha: float | Tensor, gamma: float | Tensor) -> None:
        super().__init__()
        remedy = "A mirror is the limit alpha -> 0: take 0.01; rougher than 1 are GGX and Beckmann."
        self.declare("alpha", alpha, low=0.01, high=1.0, remedy=remedy)
        remedy = "gamma = 2 is GGX; gamma -> 0 is GGX with alpha = 1, and far above 10 nothing is left of the tails."
        self.declare("gamma", gamma, low=0.0, high=10.0, remedy=remedy, open_low=True)

    @property
    def mean_alpha2(self) -> Tensor:
        """The α² of the GGX distribution with the same σ at the horizon, which is α / 2 for GGX."""
        zero = torch.zeros_like(self.alpha)
        equivalent = 2 * downward_area(incidence(self.alpha, self.gamma, Vec3(torch.ones_like(zero), zero, zero)))
        return equivalent * equivalent

    def normal_density(self, m: Vec3) -> Tensor:
        # [Burley2012] Eq. 1** of [Dimov2015]: D = (γ − 1)(α² − 1) / (π (1 − α^{2(1−γ)})) · q^−γ, q = sin²θ + α² cos²θ.
        # With a = −ln α² and e(x) = (eˣ − 1) / x it is e(a) / (π e((1 − γ) a)) · (q / α²)^−γ: no singularity at γ = 1
        # or α = 1 is left.
        up = m.z > 0
        a = -2 * torch.log(self.alpha)
        ratio = m.z * m.z + (m.x * m.x + m.y * m.y) / (self.alpha * self.alpha)
        power = torch.exp(-self.gamma * torch.log(torch.where(up, ratio, 1.0)))
        return torch.where(up, exp_ratio(a) / (math.pi * exp_ratio((1 - self.gamma) * a)) * power, 0.0)

    def projected_area(self, w: Vec3) -> Tensor:
        below = w.z < 0
        # Not abs(): its gradient at the horizon is 0.
        z = torch.where(below, -w.z, w.z)
        if self.alpha.dtype == torch.float32 and self.alpha.ndim == 0 == self.gamma.ndim and not is_recorded():
            down = downward_area_by_spline(self.alpha, self.gamma, z, w.x * w.x + w.y * w.y)
        else:
            down = downward_area(incidence(self.alpha, self.gamma, w))
        return torch.where(below, down, z + down)

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        return visible_normal(self.alpha, self.gamma, w, u0, u1)
