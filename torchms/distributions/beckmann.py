"""The Beckmann distribution: the normals of a Gaussian random surface."""

import math

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.distributions.gaussian_slopes import gaussian_area, visible_slopes
from torchms.maths.frame import Vec3, dot, normalized
from torchms.maths.numerics import smallest
from torchms.maths.special import constant


class Beckmann(EllipticDistribution):
    """Beckmann normals with roughness α_x = `alpha` and α_y = `alpha_y` (isotropic if it is not given) [Walter2007].

    The slopes of the surface are Gaussian, with variances α_x² / 2 and α_y² / 2.
    `alpha`, `alpha_y`: float, tensor or per-pixel map (*batch), buffer or `nn.Parameter`, in [1e-3, 2].
    Raises ValueError outside that range.
    """

    sources = ("Walter2007",)

    def normal_density(self, m: Vec3) -> Tensor:
        slope2, scale = self.density_parts(m)
        return torch.exp(-slope2) * scale

    def projected_area(self, w: Vec3) -> Tensor:
        z, below, c2, tail = gaussian_area(self.stretched(w))
        downward = torch.exp(-c2) * tail
        return torch.where(below, downward, z + downward)

    def visible_density(self, w: Vec3, m: Vec3) -> Tensor:
        # D(m) ⟨w, m⟩ / σ(w). Below the horizon D and σ share the factor e^{−c²}, as every visible slope is steeper than
        # w; without it neither underflows. What is left of σ is too small to divide by only for c > 1e4 or so.
        slope2, scale = self.density_parts(m)
        z, below, c2, tail = gaussian_area(self.stretched(w))
        area = torch.where(below, tail, z + torch.exp(-c2) * tail)
        cos = dot(w, m)
        visible = (cos > 0) & (scale > 0) & (area > math.sqrt(smallest(z.dtype)))
        exponent = torch.where(visible, torch.where(below, c2, 0.0) - slope2, 0.0)
        density = torch.exp(exponent) * scale * cos / torch.where(visible, area, 1.0)
        return torch.where(visible, density, 0.0)

    def density_parts(self, m: Vec3) -> tuple[Tensor, Tensor]:
        """The squared stretched slope of m and D e^{slope²}; 0 and 0 at and below the horizon."""
        # [Walter2007] Eq. 25, stretched: D = exp(−(x²/α_x² + y²/α_y²) / z²) / (π α_x α_y z⁴). Below z = 1e-4 it is 0 in
        # float64, too, as α ≤ 2: exp(−1 / (2 z)²) underflows at z = 0.018.
        ax, ay = self.alphas
        up = m.z > 1e-4
        inverse = 1 / torch.where(up, m.z, 1.0)
        p, q = m.x * inverse / ax, m.y * inverse / ay
        inverse2 = inverse * inverse
        scale = inverse2 * inverse2 / (constant(math.pi, m.z) * ax * ay)
        return torch.where(up, p * p + q * q, 0.0), torch.where(up, scale, 0.0)

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        ax, ay = self.alphas
        p, q = visible_slopes(self.stretched(w), u0, u1)
        # m ∝ (−slope_x, −slope_y, 1).
        return normalized(Vec3(-ax * p, -ay * q, torch.ones_like(p)))
