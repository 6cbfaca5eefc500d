"""The walk by visible normals that the estimators share."""

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from torchms.estimators.base import Exit, Scattering, check_max_order
from torchms.maths.frame import Vec3, scaled
from torchms.maths.numerics import differentiated
from torchms.paths.detached import Anchors
from torchms.paths.segments import Leg, Segment
from torchms.paths.vertex import Bounce, Side, Vertex


class PathTracer(Scattering):
    """A walk by visible normals from wi; with next-event estimation, every vertex is connected to wo.

    One walk serves all orders. Its weight after j bounces is the product of the phase functions over their densities:
    the Fresnel terms. The heights are the segment's affair.

    attached: in `backward`, whether the directions that were drawn follow the parameters (as they do at fixed random
    numbers), or are held, see `torchms.paths.detached`. None, the default, takes what is unbiased and has less variance:
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

    def _numbers(self, vertex: Vertex, u: Sequence[Tensor], k: int) -> tuple[Tensor, ...]:
        """The vertex's random numbers of bounce k = 1 … K."""
        first = 1 + (k - 1) * (vertex.n_uniforms + self.segment.n_uniforms)
        return tuple(u[first + i] for i in range(vertex.n_uniforms))

    def _heights(self, vertex: Vertex, u: Sequence[Tensor], k: int) -> tuple[Tensor, ...]:
        """The segment's random numbers of the leg after bounce k = 0 … K − 1: they follow those of bounce k + 1."""
        first = 1 + k * (vertex.n_uniforms + self.segment.n_uniforms) + vertex.n_uniforms
        return tuple(u[first + i] for i in range(self.segment.n_uniforms))

    def _anchors(self, vertex: Vertex, wi: Vec3, wo: Vec3 | None) -> Anchors | None:
        """What directions are held relative to; None if they are attached."""
        attached = (wo is None or not vertex.jumps) if self.attached is None else self.attached
        return None if attached else vertex.anchors(wi, wo)

    def _bounce(
        self,
        vertex: Vertex[Side],
        w: Vec3,
        normal: Vec3,
        numbers: tuple[Tensor, ...],
        side: Side,
        anchors: Anchors | None,
    ) -> Bounce[Side]:
        """A direction off the facet, held unless `anchors` is None or nobody wants a gradient."""
        bounce = vertex.sample(w, normal, numbers, side)
        if anchors is None or not differentiated(*bounce.d, *normal, *anchors):
            return bounce
        return vertex.detached(bounce, w, normal, side, anchors)

    def evaluate(self, vertex: Vertex[Side], wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        distribution, segment = vertex.distribution, self.segment
        w, side, served = vertex.enter(wi)
        served_o = vertex.serves(wo)
        anchors = self._anchors(vertex, wi, wo)
        state = segment.start(
            Leg(distribution.blocking(-w), -w.z > 0, None, self._heights(vertex, u, 0)), vertex.monotone
        )
        # Λ is even under a turn about the normal, so this is Λ of wo in whichever frame it points up.
        lam_o = distribution.blocking(scaled(wo, torch.where(wo.z < 0, -1.0, 1.0).to(wo.z.dtype)))
        weight: Tensor | None = None
        orders = []
        for k in range(1, self.max_order + 1):
            last = k == self.max_order
            local_o = vertex.local(wo, side)
            normal = numbers = None
            if not last or vertex.phase_needs_normal:
                numbers = self._numbers(vertex, u, k)
                normal = vertex.visible_normal(w, numbers[0], numbers[1])
            value = vertex.phase(w, local_o, normal, side)
            value = value * segment.escape(state, Leg(lam_o, served_o, vertex.leaves_through(local_o)))
            value = value if weight is None else weight * value
            orders.append(torch.where(served & served_o, value, 0.0))
            if last:
                break
            assert normal is not None and numbers is not None
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, anchors)
            state = segment.extend(state, self._leg(vertex, side, bounce, self._heights(vertex, u, k)))
            weight = bounce.weight if weight is None else weight * bounce.weight
            w, side = -bounce.d, bounce.side
        return orders

    def walk(self, vertex: Vertex[Side], wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        distribution, segment = vertex.distribution, self.segment
        w, entered, served = vertex.enter(wi)
        side = entered
        anchors = self._anchors(vertex, wi, None)
        state = segment.start(
            Leg(distribution.blocking(-w), -w.z > 0, None, self._heights(vertex, u, 0)), vertex.monotone
        )
        weight: Tensor = served.to(w.z.dtype)[None]
        for k in range(1, self.max_order + 1):
            last = k == self.max_order
            numbers = self._numbers(vertex, u, k)
            normal = vertex.visible_normal(w, numbers[0], numbers[1])
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, anchors)
            leg = self._leg(vertex, side, bounce, () if last else self._heights(vertex, u, k))
            weight = weight * bounce.weight
            transmitted = vertex.crossed(entered, bounce.side)
            yield Exit(
                vertex.world(bounce.d, bounce.side),
                weight,
                segment.escape(state, leg),
                torch.zeros_like(leg.up) if transmitted is None else transmitted,
            )
            if not last:
                state = segment.extend(state, leg)
            w, side = -bounce.d, bounce.side

    def _leg(self, vertex: Vertex[Side], side: Side, bounce: Bounce[Side], heights: tuple[Tensor, ...]) -> Leg:
        """The leg that a bounce on `side` begins."""
        d = bounce.d
        return Leg(vertex.distribution.blocking(d), d.z > 0, vertex.crossed(side, bounce.side), heights)
