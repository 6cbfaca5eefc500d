"""Proposals for wo with exact densities: what `BSDF.sample` draws from and `BSDF.pdf` evaluates.

Each is a mixture of the single-bounce lobes, by visible normals, and one lobe for all that bounces more often, whose
weight follows the roughness. A single-bounce direction that ends on the wrong side of the surface, where the light
would bounce on, is folded back across it: the density stays exact and normalised, and no sample is lost.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import Vec3, dot, mirrored, plus, reflect, refract, select
from torchms.paths.refractive import Refractive, channel_mean
from torchms.sampling.warps import cosine_hemisphere, uniform_hemisphere


class Proposal(ABC):
    """A normalised density over wo, given wi."""

    n_uniforms: int

    @abstractmethod
    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        """A direction with density `density`."""

    @abstractmethod
    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        """Density at `wo` [1/sr]; zero where `wi` is on a side that the surface does not serve."""

    def from_three(self, wi: Vec3, u0: Tensor, u1: Tensor, u2: Tensor) -> list[Tensor]:
        """The numbers of `sample` from three, which is what a renderer has: one that has chosen serves again, stretched."""
        return [u0, u1, u2]


def higher_order_share(distribution: MicrofacetDistribution) -> Tensor:
    """Weight of the lobe for the higher orders: α² / (1 + α²) of the mean square roughness."""
    alpha2 = distribution.mean_alpha2
    return alpha2 / (1 + alpha2)


def folded_up(d: Vec3) -> Vec3:
    """d, mirrored across the surface if it points below."""
    return Vec3(d.x, d.y, d.z.abs())


@dataclass(frozen=True)
class ReflectionProposal(Proposal):
    """Reflections about visible normals (bounded ones, where there are), folded up, and a cosine lobe."""

    distribution: MicrofacetDistribution
    n_uniforms = 3

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        single = folded_up(reflect(wi, self.distribution.reflecting_normal(wi, u[1], u[2])))
        return select(u[0] < higher_order_share(self.distribution), cosine_hemisphere(u[1], u[2]), single)

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        q = higher_order_share(self.distribution)
        single = self._reflected(wi, wo) + self._reflected(wi, mirrored(wo))
        return torch.where((wi.z > 0) & (wo.z > 0), (1 - q) * single + q * wo.z / math.pi, 0.0)

    def _reflected(self, wi: Vec3, wo: Vec3) -> Tensor:
        return self.distribution.reflecting_density(wi, plus(wi, wo))


@dataclass(frozen=True)
class DielectricProposal(Proposal):
    """Reflections and refractions by visible normals, folded to their side, and a cosine lobe on either side."""

    vertex: Refractive
    n_uniforms = 4

    def from_three(self, wi: Vec3, u0: Tensor, u1: Tensor, u2: Tensor) -> list[Tensor]:
        q = higher_order_share(self.vertex.distribution)
        return [u0, u1, u2, torch.where(u0 < q, u0 / q, (u0 - q) / (1 - q))]

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        w, side, _ = self.vertex.enter(wi)
        m = self.vertex.distribution.visible_normal(w, u[1], u[2])
        refracted = refract(w, m, self.vertex.fresnel.relative_eta(side))
        F = channel_mean(self.vertex.reflectance(dot(w, m), side))
        single = select(u[3] >= F, -folded_up(-refracted), folded_up(reflect(w, m)))
        lobe = cosine_hemisphere(u[1], u[2])
        either = select(u[3] >= 0.5, -lobe, lobe)
        chosen = select(u[0] < higher_order_share(self.vertex.distribution), either, single)
        return self.vertex.world(chosen, side)

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        w, side, served = self.vertex.enter(wi)
        d = self.vertex.local(wo, side)
        q = higher_order_share(self.vertex.distribution)
        density = self.vertex.transport_density
        single = density(w, d, side, d.z < 0) + density(w, mirrored(d), side, d.z < 0)
        return torch.where(served & (d.z != 0), (1 - q) * single + q * (0.5 / math.pi) * d.z.abs(), 0.0)


@dataclass(frozen=True)
class HemisphereProposal(Proposal):
    """A cosine lobe and, by the share of the higher orders, a uniform one: what a rough diffuse surface looks like."""

    distribution: MicrofacetDistribution
    n_uniforms = 3

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        flat = uniform_hemisphere(u[1], u[2])
        return select(u[0] < higher_order_share(self.distribution), flat, cosine_hemisphere(u[1], u[2]))

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        q = higher_order_share(self.distribution)
        density = (1 - q) * wo.z / math.pi + q * (0.5 / math.pi)
        return torch.where((wi.z > 0) & (wo.z > 0), density, 0.0)
