"""Vertex terms: what one facet does to light, seen from either side of the horizon.

`w` is the view direction at the vertex, `d` the direction light takes; both are in the frame of the side the light is
on, `w` may lie below the horizon. The kernel `phase` is the vertex term divided by a(w): the phase function of
[Heitz2016], which is what a walk by visible normals multiplies.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.frame import Vec3, dot, half_vector, normalized, orthonormal_basis, reflect, refract, scaled, select
from torchms.fresnel.base import Fresnel
from torchms.fresnel.dielectric import fresnel_dielectric
from torchms.module import channels_first
from torchms.numerics import safe_div, score, smallest
from torchms.paths.held import Knots, constant, hold
from torchms.sampling.warps import cosine_hemisphere


class Bounce(NamedTuple):
    """What came out of a vertex: the direction in the frame of the side it runs on, its weight (C, …), and sides.

    crossed, side: None where no facet transmits; else whether the ray changed side, and the side it is on now (±1).
    """

    d: Vec3
    weight: Tensor
    crossed: Tensor | None = None
    side: Tensor | None = None


class View(NamedTuple):
    """A direction in which a facet is seen, in the frame of its own side: what one of two joined walks brings.

    area: σ(direction). normal: the facet drawn for this view, where one was. side: ±1, None where no facet transmits.
    """

    direction: Vec3
    area: Tensor
    normal: Vec3 | None
    side: Tensor | None


class Densities(NamedTuple):
    """Densities of sampling a facet's two directions from each other: x → y and y → x [1/sr]."""

    forward: Tensor
    backward: Tensor


class Vertex(ABC):
    """One interaction with a facet of the distribution."""

    distribution: MicrofacetDistribution
    n_uniforms: int
    """Random numbers a bounce draws; the first two choose the facet."""
    monotone: bool
    """Whether an upgoing ray can only be turned further up."""
    phase_needs_normal: bool = False
    """Whether `phase` is an estimate that needs a sampled normal."""
    transmits: bool = False
    jumps: bool = True
    """Whether `phase` jumps somewhere: at h_z = 0, where the density of normals need not vanish."""

    @abstractmethod
    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Tensor | None) -> Tensor:
        """v(w, d) / a(w) [1/sr], (C, …)."""

    @abstractmethod
    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor | None) -> Bounce:
        """A direction off the facet with normal `normal`; `numbers` are those after the first two."""

    @abstractmethod
    def held(self, bounce: Bounce, w: Vec3, normal: Vec3, side: Tensor | None, knots: Knots) -> Bounce:
        """`bounce` of `sample` with its direction held: the weight's gradient is that of phase / held density."""

    @abstractmethod
    def density(self, w: Vec3, d: Vec3, side: Tensor | None = None) -> Tensor:
        """Density [1/sr] of the direction that `visible_normal` and `sample` give together."""

    @abstractmethod
    def densities(self, x: View, y: View, crossed: Tensor | None) -> Densities:
        """What the balance heuristic takes for the densities between two views of one facet."""

    @abstractmethod
    def connect(self, x: View, y: View, crossed: Tensor | None, densities: Densities) -> Tensor:
        """v(x, y) / (a(x) σ(y)), (C, …), for light that came from x and leaves towards y; may be an estimate."""

    def value(self, w: Vec3, d: Vec3, normal: Vec3 | None = None, side: Tensor | None = None) -> Tensor:
        """The vertex term v(w, d) of THEORY section 4, (C, …)."""
        return self.distribution.blocking(-w) * self.phase(w, d, normal, side)

    def relative_eta(self, side: Tensor) -> Tensor:
        """n_transmitted / n_incident for light that arrives on `side`; 1 where no facet transmits."""
        return torch.ones_like(side)

    def knots(self, wi: Vec3, wo: Vec3 | None) -> Knots:
        """What directions between `wi` and `wo` (None: anywhere) are held relative to; none if nothing jumps."""
        return ()

    def enter(self, wi: Vec3) -> tuple[Vec3, Tensor | None, Tensor]:
        """Light arrives from `wi`: the view direction in the local frame, the side, and whether the side is ours."""
        return wi, None, wi.z > 0

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """The facet that light from `w` meets."""
        return self.distribution.visible_normal(w, u0, u1)


def reflection_density(distribution: MicrofacetDistribution, w: Vec3, h: Vec3) -> Tensor:
    """Density D(h) / (4 a(w) |w_z|) of reflecting w about the visible normal h [Heitz2016]."""
    return distribution.normal_density(h) / (4 * distribution.guarded_area(w))


@dataclass(frozen=True)
class Mirror(Vertex):
    """Facets that reflect like mirrors, weighted by a Fresnel term."""

    distribution: MicrofacetDistribution
    fresnel: Fresnel
    n_uniforms = 2
    monotone = True

    def knots(self, wi: Vec3, wo: Vec3 | None) -> Knots:
        one = torch.ones_like(wi.z)
        return (-one, -wi.z, one) if wo is None else (-one, -wi.z, wo.z, one)

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Tensor | None) -> Tensor:
        h = half_vector(w, d)
        return self.fresnel.reflectance(dot(w, h)) * reflection_density(self.distribution, w, h)

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor | None) -> Bounce:
        return Bounce(reflect(w, normal), self.fresnel.reflectance(dot(w, normal)))

    def held(self, bounce: Bounce, w: Vec3, normal: Vec3, side: Tensor | None, knots: Knots) -> Bounce:
        d, growth = hold(bounce.d, knots)
        h = half_vector(w, d)
        weight = self.fresnel.reflectance(dot(w, h)) * score(reflection_density(self.distribution, w, h))
        return Bounce(d, weight if growth is None else weight * growth)

    def density(self, w: Vec3, d: Vec3, side: Tensor | None = None) -> Tensor:
        return reflection_density(self.distribution, w, half_vector(w, d))

    def densities(self, x: View, y: View, crossed: Tensor | None) -> Densities:
        D = self.distribution.normal_density(half_vector(x.direction, y.direction)) / 4
        return Densities(D / x.area, D / y.area)

    def connect(self, x: View, y: View, crossed: Tensor | None, densities: Densities) -> Tensor:
        h = half_vector(x.direction, y.direction)
        return self.fresnel.reflectance(dot(x.direction, h)) * (densities.forward / y.area)


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


@dataclass(frozen=True)
class Diffuse(Vertex):
    """Lambertian facets [HeitzDupuy2015] with an `albedo` per channel (*batch C)."""

    distribution: MicrofacetDistribution
    albedo: Tensor
    n_uniforms = 4
    monotone = False
    phase_needs_normal = True
    jumps = False

    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Tensor | None) -> Tensor:
        """(ρ / π) ⟨d, m⟩ of one visible normal m: an unbiased estimate of the mean over all of them."""
        assert normal is not None
        facing = dot(d, normal).clamp_min(0)
        return channels_first(self.albedo, facing.ndim) * (facing / math.pi)

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor | None) -> Bounce:
        c = cosine_hemisphere(numbers[0], numbers[1])
        t, b = orthonormal_basis(normal)
        d = Vec3(
            c.x * t.x + c.y * b.x + c.z * normal.x,
            c.x * t.y + c.y * b.y + c.z * normal.y,
            c.x * t.z + c.y * b.z + c.z * normal.z,
        )
        return Bounce(d, channels_first(self.albedo, d.z.ndim).expand(-1, *d.z.shape))

    def held(self, bounce: Bounce, w: Vec3, normal: Vec3, side: Tensor | None, knots: Knots) -> Bounce:
        # The facet is held with its direction: the density of the direction alone is an integral over facets.
        weight = bounce.weight * score(self.distribution.visible_density(w, constant(normal)))
        return Bounce(constant(bounce.d), weight)

    def density(self, w: Vec3, d: Vec3, side: Tensor | None = None, nodes: int = 16) -> Tensor:
        """(1 / π) ∫ ⟨d, m⟩ D_w(m) dm by the midpoint rule on nodes × nodes visible normals."""
        total = torch.zeros_like(dot(w, d))
        for i in range(nodes):
            for j in range(nodes):
                u0 = torch.full_like(w.z, (i + 0.5) / nodes)
                u1 = torch.full_like(w.z, (j + 0.5) / nodes)
                total = total + dot(d, self.visible_normal(w, u0, u1)).clamp_min(0)
        return total / (math.pi * nodes * nodes)

    def densities(self, x: View, y: View, crossed: Tensor | None) -> Densities:
        # Any positive numbers serve as weights. These are the densities of facets that are seen by x and by y
        # independently of each other, ∫⟨x, m⟩⟨y, m⟩ D dm / π ≈ σ(x) σ(y) / π.
        return Densities(y.area / math.pi, x.area / math.pi)

    def connect(self, x: View, y: View, crossed: Tensor | None, densities: Densities) -> Tensor:
        # Two estimates of the same symmetric number, ⟨y, m_x⟩ / σ(y) and ⟨x, m_y⟩ / σ(x), weighted by their σ, so that
        # a view that sees next to nothing does not blow up.
        assert x.normal is not None and y.normal is not None
        facing = dot(y.direction, x.normal).clamp_min(0) + dot(x.direction, y.normal).clamp_min(0)
        return channels_first(self.albedo, facing.ndim) * (facing / (math.pi * (x.area + y.area)))
