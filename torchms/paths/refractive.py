"""Facets of a dielectric, which reflect or refract."""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.fresnel.interface import Interface
from torchms.maths.frame import Vec3, dot, normalized, reflect, refract, scaled, select
from torchms.maths.numerics import safe_div, score_of, smallest
from torchms.paths.detached import Anchors, detached
from torchms.paths.vertex import Bounce, Densities, Vertex, View


@dataclass(frozen=True)
class Refractive(Vertex[Tensor]):
    """Facets that reflect or refract. Side +1 is outside; `fresnel` has the index n_inside / n_outside.

    Here `d` is in the frame of the side that light arrives on: below the horizon it is transmitted. All channels take
    the same directions, drawn by their mean reflectance.
    """

    distribution: MicrofacetDistribution
    fresnel: Interface
    n_uniforms = 3
    monotone = False
    transmits = True

    @property
    def eta(self) -> Tensor:
        """n_inside / n_outside."""
        return self.fresnel.eta

    def index(self, side: Tensor) -> Tensor:
        """n on `side`, relative to the outside's."""
        return torch.where(side > 0, 1.0, self.eta)

    def reflectance(self, cos: Tensor, side: Tensor) -> Tensor:
        """F of a facet met on `side` at cos θ_i = `cos`, (C, …)."""
        return self.fresnel.reflectance(side * cos.clamp(0.0, 1.0))

    def anchors(self, wi: Vec3, wo: Vec3 | None) -> Anchors:
        one = torch.ones_like(wi.z)
        ends = (-wi.z * self.index(wi.z),) if wo is None else (-wi.z * self.index(wi.z), wo.z * self.index(wo.z))
        return (-one, one, -one * self.eta, one * self.eta, *ends)

    def enter(self, wi: Vec3) -> tuple[Vec3, Tensor, Tensor]:
        side = torch.where(wi.z < 0, -1.0, 1.0).to(wi.z.dtype)
        return scaled(wi, side), side, wi.z != 0

    def serves(self, w: Vec3) -> Tensor:
        return w.z != 0

    def local(self, d: Vec3, side: Tensor) -> Vec3:
        return scaled(d, side)

    def world(self, d: Vec3, side: Tensor) -> Vec3:
        return scaled(d, side)

    def crossed(self, before: Tensor, after: Tensor) -> Tensor:
        return before != after

    def leaves_through(self, d: Vec3) -> Tensor:
        return d.z < 0

    def relative_eta2(self, before: Tensor, after: Tensor) -> Tensor:
        eta = self.fresnel.relative_eta(before)
        return torch.where(before == after, 1.0, eta * eta)

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Tensor) -> Tensor:
        return self.transport(w, d, side, d.z < 0)

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor) -> Bounce[Tensor]:
        F = self.reflectance(dot(w, normal), side)
        crossed = numbers[0] >= channel_mean(F)
        d = select(crossed, -refract(w, normal, self.fresnel.relative_eta(side)), reflect(w, normal))
        # The weight is 1 if there is one channel, but the probability of the choice depends on the parameters: without
        # its score, the gradient of the expectation would miss most of Fresnel's.
        share = torch.where(crossed, 1 - F, F)
        return Bounce(d, score_of(share, channel_mean(share)), torch.where(crossed, -side, side))

    def detached(self, bounce: Bounce[Tensor], w: Vec3, normal: Vec3, side: Tensor, anchors: Anchors) -> Bounce[Tensor]:
        d, growth = detached(bounce.d, anchors, bounce.side * self.index(bounce.side))
        crossed = self.crossed(side, bounce.side)
        density = self.transport(w, select(crossed, -d, d), side, crossed)
        weight = score_of(density, channel_mean(density))
        return Bounce(d, weight if growth is None else weight * growth, bounce.side)

    def density(self, w: Vec3, d: Vec3, side: Tensor) -> Tensor:
        return self.transport_density(w, d, side, d.z < 0)

    def densities(self, x: View[Tensor], y: View[Tensor]) -> Densities:
        crossed = self.crossed(x.side, y.side)
        forward = channel_mean(self._joined(x, y, crossed))
        # v(x, y) |x_z| = η² v(y, x) |y_z|, with η = 1 for a reflection.
        eta = torch.where(crossed, self.fresnel.relative_eta(x.side), 1.0)
        return Densities(forward, forward * x.area / (y.area * eta * eta))

    def connect(self, x: View[Tensor], y: View[Tensor], densities: Densities) -> Tensor:
        # One channel is its own mean: it is not computed anew.
        one = self.fresnel.n_channels == 1
        return (densities.forward[None] if one else self._joined(x, y, self.crossed(x.side, y.side))) / y.area

    def _joined(self, x: View[Tensor], y: View[Tensor], crossed: Tensor) -> Tensor:
        return self.transport(x.direction, select(crossed, -y.direction, y.direction), x.side, crossed)

    def transport_density(self, w: Vec3, d: Vec3, side: Tensor, transmitted: Tensor) -> Tensor:
        """Density [1/sr] of what `sample` draws, of reflections or of refractions: the mean of `transport`."""
        return channel_mean(self.transport(w, d, side, transmitted))

    def transport(self, w: Vec3, d: Vec3, side: Tensor, transmitted: Tensor) -> Tensor:
        """Reflecting, or where `transmitted` refracting, w into d [1/sr], (C, …), whatever side of the horizon d is on.

        [Walter2007] Eqs. 13 and 16: h ∝ w + d for reflection, w + η d for refraction, turned so that it faces w. With
        visible normals the density is D(h) / σ(w) times F / 4 or (1 − F) (w·h) |d·h| η² / (w·h + η d·h)².
        """
        n = torch.where(transmitted, self.fresnel.relative_eta(side), 1.0)
        h = Vec3(w.x + n * d.x, w.y + n * d.y, w.z + n * d.z)
        length2 = dot(h, h)
        # The refracting half vector points into the denser medium: turn it so that it is an outer normal.
        h = normalized(scaled(h, torch.where(h.z < 0, -1.0, 1.0).to(h.z.dtype)))
        wh, dh = dot(w, h), dot(d, h)
        F = self.reflectance(wh, side)
        # w·h + η d·h = ±|w + η d|, the length before it was normalised.
        through = self.fresnel.transmittance(side * wh, -dh)
        jacobian = safe_div(through * wh * dh.abs() * (n * n), length2)
        good = (wh > 0) & torch.where(transmitted, dh < 0, dh > 0) & (length2 > smallest(length2.dtype))
        each = torch.where(transmitted, jacobian, F / 4)
        density = self.distribution.normal_density(h) / self.distribution.guarded_area(w) * each
        return torch.where(good, density, 0.0)


def channel_mean(x: Tensor) -> Tensor:
    """Mean over the channels, which come first."""
    return x[0] if len(x) == 1 else x.mean(0)
