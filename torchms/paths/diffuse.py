"""Lambertian facets."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import Vec3, dot, orthonormal_basis
from torchms.maths.numerics import score
from torchms.parameters.declared import channels_first
from torchms.paths.detached import Anchors, constant
from torchms.paths.vertex import Bounce, Densities, OpaqueVertex, View
from torchms.sampling.warps import cosine_hemisphere


@dataclass(frozen=True)
class Diffuse(OpaqueVertex):
    """Lambertian facets [HeitzDupuy2015] with an `albedo` per channel (*batch C)."""

    distribution: MicrofacetDistribution
    albedo: Tensor
    n_uniforms = 4
    monotone = False
    phase_needs_normal = True
    jumps = False

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: None) -> Tensor:
        """(ρ / π) ⟨d, m⟩ of one visible normal m: an unbiased estimate of the mean over all of them."""
        assert normal is not None
        facing = dot(d, normal).clamp_min(0)
        return channels_first(self.albedo, facing.ndim) * (facing / math.pi)

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: None) -> Bounce[None]:
        c = cosine_hemisphere(numbers[0], numbers[1])
        t, b = orthonormal_basis(normal)
        d = Vec3(
            c.x * t.x + c.y * b.x + c.z * normal.x,
            c.x * t.y + c.y * b.y + c.z * normal.y,
            c.x * t.z + c.y * b.z + c.z * normal.z,
        )
        return Bounce(d, channels_first(self.albedo, d.z.ndim).expand(-1, *d.z.shape), None)

    def detached(self, bounce: Bounce[None], w: Vec3, normal: Vec3, side: None, anchors: Anchors) -> Bounce[None]:
        # The facet is held with its direction: the density of the direction alone is an integral over facets.
        weight = bounce.weight * score(self.distribution.visible_density(w, constant(normal)))
        return Bounce(constant(bounce.d), weight, None)

    def density(self, w: Vec3, d: Vec3, side: None = None, nodes: int = 16) -> Tensor:
        """(1 / π) ∫ ⟨d, m⟩ D_w(m) dm by the midpoint rule on nodes × nodes visible normals."""
        total = torch.zeros_like(dot(w, d))
        for i in range(nodes):
            for j in range(nodes):
                u0 = torch.full_like(w.z, (i + 0.5) / nodes)
                u1 = torch.full_like(w.z, (j + 0.5) / nodes)
                total = total + dot(d, self.visible_normal(w, u0, u1)).clamp_min(0)
        return total / (math.pi * nodes * nodes)

    def densities(self, x: View[None], y: View[None]) -> Densities:
        # Any positive numbers serve as weights. These are the densities of facets that are seen by x and by y
        # independently of each other, ∫⟨x, m⟩⟨y, m⟩ D dm / π ≈ σ(x) σ(y) / π.
        return Densities(y.area / math.pi, x.area / math.pi)

    def connect(self, x: View[None], y: View[None], densities: Densities) -> Tensor:
        # Two estimates of the same symmetric number, ⟨y, m_x⟩ / σ(y) and ⟨x, m_y⟩ / σ(x), weighted by their σ, so that
        # a view that sees next to nothing does not blow up.
        assert x.normal is not None and y.normal is not None
        facing = dot(y.direction, x.normal).clamp_min(0) + dot(x.direction, y.normal).clamp_min(0)
        return channels_first(self.albedo, facing.ndim) * (facing / (math.pi * (x.area + y.area)))
