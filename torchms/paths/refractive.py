"""Facets of a dielectric, which reflect or refract."""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.fresnel.dielectric import fresnel_dielectric
from torchms.maths.frame import Vec3, dot, normalized, reflect, refract, scaled, select
from torchms.maths.numerics import safe_div, score, smallest
from torchms.paths.held import Knots, hold
from torchms.paths.vertex import Bounce, Densities, Vertex, View


@dataclass(frozen=True)
class Refractive(Vertex):
    """Facets of a dielectric, which reflect or refract. Side +1 is outside; `eta` = n_inside / n_outside.

    Here `d` is in the frame of the side that light arrives on: below the horizon it is transmitted.
    """

    distribution: MicrofacetDistribution
    eta: Tensor
    n_uniforms = 3
    monotone = False
    transmits = True

    def relative_eta(self, side: Tensor) -> Tensor:
        """n_transmitted / n_incident for light that arrives on `side`."""
        return torch.where(side > 0, self.eta, 1 / self.eta)

    def index(self, side: Tensor) -> Tensor:
        """n on `side`, relative to the outside's."""
        return torch.where(side > 0, 1.0, self.eta)

    def knots(self, wi: Vec3, wo: Vec3 | None) -> Knots:
        one = torch.ones_like(wi.z)
        ends = (-wi.z * self.index(wi.z),) if wo is None else (-wi.z * self.index(wi.z), wo.z * self.index(wo.z))
        return (-one, one, -one * self.eta, one * self.eta, *ends)

    def enter(self, wi: Vec3) -> tuple[Vec3, Tensor | None, Tensor]:
        side = torch.where(wi.z < 0, -1.0, 1.0).to(wi.z.dtype)
        return scaled(wi, side), side, wi.z != 0

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Tensor | None) -> Tensor:
        return self.density(w, d, side)[None]

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor | None) -> Bounce:
        assert side is not None
        eta = self.relative_eta(side)
        F, _ = fresnel_dielectric(dot(w, normal).clamp(0.0, 1.0), eta)
        crossed = numbers[0] >= F
        d = select(crossed, -refract(w, normal, eta), reflect(w, normal))
        # The weight is 1, but the probability of the choice depends on the parameters: without its score, the gradient
        # of the expectation would miss most of Fresnel's.
        weight = score(torch.where(crossed, 1 - F, F))
        return Bounce(d, weight[None], crossed, torch.where(crossed, -side, side))

    def held(self, bounce: Bounce, w: Vec3, normal: Vec3, side: Tensor | None, knots: Knots) -> Bounce:
        assert side is not None and bounce.crossed is not None
        assert bounce.side is not None
        d, growth = hold(bounce.d, knots, bounce.side * self.index(bounce.side))
        weight = score(self.transport(w, select(bounce.crossed, -d, d), side, bounce.crossed))
        return Bounce(d, (weight if growth is None else weight * growth)[None], bounce.crossed, bounce.side)

    def density(self, w: Vec3, d: Vec3, side: Tensor | None = None) -> Tensor:
        side = torch.ones_like(w.z) if side is None else side
        return self.transport(w, d, side, d.z < 0)

    def densities(self, x: View, y: View, crossed: Tensor | None) -> Densities:
        assert crossed is not None and x.side is not None
        d = select(crossed, -y.direction, y.direction)
        forward = self.transport(x.direction, d, x.side, crossed)
        # v(x, y) |x_z| = η² v(y, x) |y_z|, with η = 1 for a reflection.
        eta = torch.where(crossed, self.relative_eta(x.side), 1.0)
        return Densities(forward, forward * x.area / (y.area * eta * eta))

    def connect(self, x: View, y: View, crossed: Tensor | None, densities: Densities) -> Tensor:
        return (densities.forward / y.area)[None]

    def transport(self, w: Vec3, d: Vec3, side: Tensor, transmitted: Tensor) -> Tensor:
        """Density of reflecting, or where `transmitted` of refracting, w into d, whatever side of the horizon d is on.

        [Walter2007] Eqs. 13 and 16: h ∝ w + d for reflection, w + η d for refraction, turned so that it faces w. With
        visible normals the density is D(h) / σ(w) times F / 4 or (1 − F) (w·h) |d·h| η² / (w·h + η d·h)².
        """
        eta = self.relative_eta(side)
        n = torch.where(transmitted, eta, 1.0)
        h = Vec3(w.x + n * d.x, w.y + n * d.y, w.z + n * d.z)
        length2 = dot(h, h)
        # The refracting half vector points into the denser medium: turn it so that it is an outer normal.
        h = normalized(scaled(h, torch.where(h.z < 0, -1.0, 1.0).to(h.z.dtype)))
        wh, dh = dot(w, h), dot(d, h)
        F, _ = fresnel_dielectric(wh.clamp(0.0, 1.0), eta)
        # w·h + η d·h = ±|w + η d|, the length before it was normalised.
        jacobian = safe_div(transmittance(wh, -eta * dh, eta) * wh * dh.abs() * (n * n), length2)
        good = (wh > 0) & torch.where(transmitted, dh < 0, dh > 0) & (length2 > smallest(length2.dtype))
        each = torch.where(transmitted, jacobian, F / 4)
        density = self.distribution.normal_density(h) / self.distribution.guarded_area(w) * each
        return torch.where(good, density, 0.0)


def transmittance(c: Tensor, g: Tensor, eta: Tensor) -> Tensor:
    """1 − F from c = cos θ_i and g = η cos θ_t, both at least 0, without the cancellation near total reflection.

    [Walter2007] Eq. 22 in its two polarisations, 1 − r² with r_s = (c − g) / (c + g), r_p = (η² c − g) / (η² c + g).
    """
    c, g = c.clamp_min(0), g.clamp_min(0)
    s, p = c + g, eta * eta * c + g
    return 2 * c * g * (safe_div(torch.ones_like(s), s * s) + safe_div(eta * eta, p * p))
