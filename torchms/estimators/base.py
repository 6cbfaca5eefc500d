"""What stands in a BSDF's `scattering` slot: an estimator, or an approximation, of the sum over bounces."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.maths.frame import Vec3, scaled
from torchms.paths.held import Knots, differentiated
from torchms.paths.segments import Leg, Segment
from torchms.paths.vertex import Bounce, Vertex
from torchms.sampling.proposals import Proposal


class Exit(NamedTuple):
    """A walk after one more bounce.

    d: the direction it took, in the surface's frame. weight: (C, …) what it carries. escapes: probability that it
    leaves now (not: given that it had stayed until now). transmitted: whether it would leave on the other side.
    """

    d: Vec3
    weight: Tensor
    escapes: Tensor
    transmitted: Tensor


class Scattering(nn.Module, ABC):
    """How the bounces inside the microgeometry are summed.

    max_order: bounces that are counted, K. Results have one entry an order. is_unbiased: whether the expectation of
    each order is that of the Smith model [Heitz2016]. is_reciprocal: whether f(wi, wo) = f(wo, wi) in expectation.
    """

    max_order: int
    is_unbiased: bool
    is_reciprocal: bool

    @abstractmethod
    def n_uniforms(self, vertex: Vertex) -> int:
        """Random numbers a path of this vertex may draw."""

    @abstractmethod
    def is_deterministic(self, vertex: Vertex) -> bool:
        """Whether `evaluate` draws none of them."""

    @abstractmethod
    def check(self, vertex: Vertex) -> None:
        """Raise ValueError, with the reason and the remedy, if this estimator does not hold for `vertex`."""

    @abstractmethod
    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        """f · |cos θ_o| of each order [1/sr], each (C, N or 1, …)."""

    @abstractmethod
    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        """The walk from `wi`, bounce after bounce."""

    def proposal(self, vertex: Vertex) -> Proposal | None:
        """What `BSDF.sample` draws from, where that fits better than what the material would take; None for the latter."""
        return None


def check_max_order(max_order: int, owner: str) -> int:
    """`max_order` if it is a positive integer; ValueError otherwise."""
    if isinstance(max_order, bool) or not isinstance(max_order, int):
        raise TypeError(f"{owner}(max_order=...) must be an int; got {max_order!r}.")
    if not 1 <= max_order <= 256:
        raise ValueError(f"{owner}(max_order=...) must lie in [1, 256]; got {max_order}. One order is SingleBounce.")
    return max_order


class PathTracer(Scattering):
    """A walk by visible normals from wi; with next-event estimation, every vertex is connected to wo.

    One walk serves all orders. Its weight after j bounces is the product of the phase functions over their densities:
    the Fresnel terms. The heights are the segment's affair.

    attached: in `backward`, whether the directions that were drawn follow the parameters (as they do at fixed random
    numbers), or are held, see `torchms.paths.held`. None, the default, takes what is unbiased and has less variance:
    they are held in `evaluate` where a facet is a mirror or refracts, and follow where it is diffuse, and in `walk`.
    True is biased in `evaluate` for distributions that do not vanish at the horizon (GGX): values of mirrors and glass
    jump at h_z = 0, and its gradients miss that the jump moves. False is unbiased everywhere.
    """

    segment: Segment

    def __init__(self, segment: Segment, max_order: int, attached: bool | None = None) -> None:
        super().__init__()
        self.segment = segment
        self.max_order = check_max_order(max_order, type(self).__name__)
        if attached is not None and not isinstance(attached, bool):
            raise TypeError(f"{type(self).__name__}(attached=...) must be True, False or None; got {attached!r}.")
        self.attached = attached

    # Random numbers: number 0 stops the walk, then come those of each bounce: the vertex's and the segment's.

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + self.max_order * (vertex.n_uniforms + self.segment.n_uniforms)

    def is_deterministic(self, vertex: Vertex) -> bool:
        return self.max_order == 1 and not vertex.phase_needs_normal and self.segment.n_uniforms == 0

    def check(self, vertex: Vertex) -> None:
        if vertex.transmits and not self.segment.transmits:
            raise ValueError(
                f"{type(self.segment).__name__}() holds on one side of the surface only: its recursion over the "
                "highest collision has no counterpart for rays that change side, so it does not serve a dielectric. "
                "Use HeightWalk(), which is exact, or Unidirectional(Correlated())."
            )

    def _start(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> tuple:
        w, side, ours = vertex.enter(wi)
        d = -w
        leg = Leg(vertex.distribution.blocking(d), d.z > 0, None, self._heights(vertex, u, 0))
        return w, side, ours, self.segment.start(leg, vertex.monotone)

    def _numbers(self, vertex: Vertex, u: Sequence[Tensor], k: int) -> tuple[Tensor, ...]:
        """The vertex's random numbers of bounce k = 1 … K."""
        first = 1 + (k - 1) * (vertex.n_uniforms + self.segment.n_uniforms)
        return tuple(u[first + i] for i in range(vertex.n_uniforms))

    def _heights(self, vertex: Vertex, u: Sequence[Tensor], k: int) -> tuple[Tensor, ...]:
        """The segment's random numbers of the leg after bounce k = 0 … K − 1: they follow those of bounce k + 1."""
        first = 1 + k * (vertex.n_uniforms + self.segment.n_uniforms) + vertex.n_uniforms
        return tuple(u[first + i] for i in range(self.segment.n_uniforms))

    def _knots(self, vertex: Vertex, wi: Vec3, wo: Vec3 | None) -> Knots | None:
        """What directions are held relative to; None if they are attached."""
        attached = (wo is None or not vertex.jumps) if self.attached is None else self.attached
        return None if attached else vertex.knots(wi, wo)

    def _bounce(
        self,
        vertex: Vertex,
        w: Vec3,
        normal: Vec3,
        numbers: tuple[Tensor, ...],
        side: Tensor | None,
        knots: Knots | None,
    ) -> Bounce:
        """A direction off the facet, held unless `knots` is None or nobody wants a gradient."""
        bounce = vertex.sample(w, normal, numbers, side)
        if knots is None or not differentiated(*bounce.d, *normal, *knots):
            return bounce
        return vertex.held(bounce, w, normal, side, knots)

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        w, side, valid, state = self._start(vertex, wi, u)
        knots = self._knots(vertex, wi, wo)
        # Λ is even under a turn about the normal, so this is Λ of wo in whichever frame it points up.
        lam_o = vertex.distribution.blocking(scaled(wo, torch.where(wo.z < 0, -1.0, 1.0).to(wo.z.dtype)))
        up_o = wo.z != 0 if vertex.transmits else wo.z > 0
        weight: Tensor | None = None
        orders = []
        for k in range(1, self.max_order + 1):
            last = k == self.max_order
            local_o = wo if side is None else scaled(wo, side)
            normal = numbers = None
            if not last or vertex.phase_needs_normal:
                numbers = self._numbers(vertex, u, k)
                normal = vertex.visible_normal(w, numbers[0], numbers[1])
            crossed_o = local_o.z < 0 if vertex.transmits else None
            value = vertex.phase(w, local_o, normal, side)
            value = value * self.segment.escape(state, Leg(lam_o, up_o, crossed_o))
            value = value if weight is None else weight * value
            orders.append(torch.where(valid & up_o, value, 0.0))
            if last:
                break
            assert normal is not None and numbers is not None
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, knots)
            leg = Leg(
                vertex.distribution.blocking(bounce.d), bounce.d.z > 0, bounce.crossed, self._heights(vertex, u, k)
            )
            state = self.segment.extend(state, leg)
            weight = bounce.weight if weight is None else weight * bounce.weight
            w, side = -bounce.d, bounce.side
        return orders

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        w, side, valid, state = self._start(vertex, wi, u)
        entered = side
        knots = self._knots(vertex, wi, None)
        weight: Tensor = valid.to(w.z.dtype)[None]
        for k in range(1, self.max_order + 1):
            numbers = self._numbers(vertex, u, k)
            normal = vertex.visible_normal(w, numbers[0], numbers[1])
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, knots)
            heights = self._heights(vertex, u, k) if k < self.max_order else ()
            leg = Leg(vertex.distribution.blocking(bounce.d), bounce.d.z > 0, bounce.crossed, heights)
            weight = weight * bounce.weight
            escapes = self.segment.escape(state, leg)
            if bounce.side is None or entered is None:
                yield Exit(bounce.d, weight, escapes, torch.zeros_like(leg.up))
            else:
                yield Exit(scaled(bounce.d, bounce.side), weight, escapes, bounce.side != entered)
            if k < self.max_order:
                state = self.segment.extend(state, leg)
            w, side = -bounce.d, bounce.side
