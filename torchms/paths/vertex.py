"""Vertex terms: what one facet does to light, seen from either side of the horizon.

`w` is the view direction at the vertex, `d` the direction light takes; both are in the frame of the side the light is
on, `w` may lie below the horizon. The kernel `phase` is the vertex term divided by a(w): the phase function of
[Heitz2016], which is what a walk by visible normals multiplies.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import Vec3
from torchms.paths.detached import Anchors

Side = TypeVar("Side", None, Tensor)
"""The side of the surface that light is on: ±1 a ray where facets transmit, None where none does."""


@dataclass(frozen=True)
class Bounce(Generic[Side]):
    """What came out of a vertex: the direction in the frame of the side it runs on, its weight (C, …), and that side."""

    d: Vec3
    weight: Tensor
    side: Side


@dataclass(frozen=True)
class View(Generic[Side]):
    """A direction in which a facet is seen, in the frame of its own side: what one of two joined walks brings.

    area: σ(direction). normal: the facet drawn for this view, where one was.
    """

    direction: Vec3
    area: Tensor
    normal: Vec3 | None
    side: Side


class Densities(NamedTuple):
    """Densities of sampling a facet's two directions from each other: x → y and y → x [1/sr]."""

    forward: Tensor
    backward: Tensor


class Vertex(ABC, Generic[Side]):
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

    # The frame. Light on the other side of a surface sees it turned over: the same facets, the directions negated.

    @abstractmethod
    def enter(self, wi: Vec3) -> tuple[Vec3, Side, Tensor]:
        """Light arrives from `wi`: the view direction in the frame of its side, that side, and whether it is served."""

    @abstractmethod
    def serves(self, w: Vec3) -> Tensor:
        """Whether the surface scatters light from, or to, the direction `w` of its own frame."""

    @abstractmethod
    def local(self, d: Vec3, side: Side) -> Vec3:
        """The direction `d` of the surface's frame in the frame of `side`."""

    @abstractmethod
    def world(self, d: Vec3, side: Side) -> Vec3:
        """The direction `d` of the frame of `side` in the surface's frame."""

    @abstractmethod
    def crossed(self, before: Side, after: Side) -> Tensor | None:
        """Whether light went from one side to the other; None where no facet transmits."""

    @abstractmethod
    def leaves_through(self, d: Vec3) -> Tensor | None:
        """Whether light that leaves the surface along `d`, in the frame it arrived in, crosses; None where none does."""

    def relative_eta2(self, before: Side, after: Side) -> Tensor | None:
        """(n after / n before)²: what a radiance along a ray is multiplied by from side to side; None where it is 1."""
        return None

    # The term.

    @abstractmethod
    def phase(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Side) -> Tensor:
        """v(w, d) / a(w) [1/sr], (C, …)."""

    @abstractmethod
    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Side) -> Bounce[Side]:
        """A direction off the facet with normal `normal`; `numbers` are those after the first two."""

    @abstractmethod
    def detached(self, bounce: Bounce[Side], w: Vec3, normal: Vec3, side: Side, anchors: Anchors) -> Bounce[Side]:
        """`bounce` of `sample` with its direction held: the weight's gradient is that of phase / held density."""

    @abstractmethod
    def density(self, w: Vec3, d: Vec3, side: Side) -> Tensor:
        """Density [1/sr] of the direction that `visible_normal` and `sample` give together."""

    @abstractmethod
    def densities(self, x: View[Side], y: View[Side]) -> Densities:
        """What the balance heuristic takes for the densities between two views of one facet."""

    @abstractmethod
    def connect(self, x: View[Side], y: View[Side], densities: Densities) -> Tensor:
        """v(x, y) / (a(x) σ(y)), (C, …), for light that came from x and leaves towards y; may be an estimate."""

    def value(self, w: Vec3, d: Vec3, normal: Vec3 | None, side: Side) -> Tensor:
        """The vertex term v(w, d) of the path integral (docs/theory.md, section 4), (C, …)."""
        return self.distribution.blocking(-w) * self.phase(w, d, normal, side)

    def anchors(self, wi: Vec3, wo: Vec3 | None) -> Anchors:
        """What directions between `wi` and `wo` (None: anywhere) are held relative to; none if nothing jumps."""
        return ()

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """The facet that light from `w` meets."""
        return self.distribution.visible_normal(w, u0, u1)


class OpaqueVertex(Vertex[None]):
    """A facet that light does not pass: there is one side, and one frame."""

    def enter(self, wi: Vec3) -> tuple[Vec3, None, Tensor]:
        return wi, None, wi.z > 0

    def serves(self, w: Vec3) -> Tensor:
        return w.z > 0

    def local(self, d: Vec3, side: None) -> Vec3:
        return d

    def world(self, d: Vec3, side: None) -> Vec3:
        return d

    def crossed(self, before: None, after: None) -> None:
        return None

    def leaves_through(self, d: Vec3) -> None:
        return None

    def value(self, w: Vec3, d: Vec3, normal: Vec3 | None = None, side: None = None) -> Tensor:
        return super().value(w, d, normal, side)


def reflection_density(distribution: MicrofacetDistribution, w: Vec3, v: Vec3) -> Tensor:
    """Density D(h) / (4 a(w) |w_z|) of reflecting w about the visible normal h along v, of any length [Heitz2016]."""
    return distribution.density_along(v) / (4 * distribution.guarded_area(w))
