"""Vertex terms: what one facet does to light, seen from either side of the horizon.

`w` is the view direction at the vertex, `d` the direction light takes; both are in the frame of the side the light is
on, `w` may lie below the horizon. The kernel `phase` is the vertex term divided by a(w): the phase function of
[Heitz2016], which is what a walk by visible normals multiplies.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import Vec3
from torchms.paths.held import Knots


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
        """The vertex term v(w, d) of the path integral (docs/theory.md, section 4), (C, …)."""
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
