"""Facets that reflect like mirrors."""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.fresnel.base import Fresnel
from torchms.maths.frame import Vec3, cosine, dot, plus, reflect
from torchms.maths.numerics import score
from torchms.paths.detached import Anchors, detached
from torchms.paths.vertex import Bounce, Densities, OpaqueVertex, View, reflection_density


@dataclass(frozen=True)
class Mirror(OpaqueVertex):
    """Facets that reflect like mirrors, weighted by a Fresnel term."""

    distribution: MicrofacetDistribution
    fresnel: Fresnel
    n_uniforms = 2
    monotone = True

    def anchors(self, wi: Vec3, wo: Vec3 | None) -> Anchors:
        one = torch.ones_like(wi.z)
        return (-one, -wi.z, one) if wo is None else (-one, -wi.z, wo.z, one)

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: None) -> Tensor:
        v = plus(w, d)
        return self.fresnel.reflectance(cosine(w, v)) * reflection_density(self.distribution, w, v)

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: None) -> Bounce[None]:
        return Bounce(reflect(w, normal), self.fresnel.reflectance(dot(w, normal)), None)

    def detached(self, bounce: Bounce[None], w: Vec3, normal: Vec3, side: None, anchors: Anchors) -> Bounce[None]:
        d, growth = detached(bounce.d, anchors)
        v = plus(w, d)
        weight = self.fresnel.reflectance(cosine(w, v)) * score(reflection_density(self.distribution, w, v))
        return Bounce(d, weight if growth is None else weight * growth, None)

    def density(self, w: Vec3, d: Vec3, side: None = None) -> Tensor:
        return reflection_density(self.distribution, w, plus(w, d))

    def densities(self, x: View[None], y: View[None]) -> Densities:
        D = self.distribution.density_along(plus(x.direction, y.direction)) / 4
        return Densities(D / x.area, D / y.area)

    def connect(self, x: View[None], y: View[None], densities: Densities) -> Tensor:
        v = plus(x.direction, y.direction)
        return self.fresnel.reflectance(cosine(x.direction, v)) * (densities.forward / y.area)
