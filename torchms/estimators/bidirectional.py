"""The position-free path integral, estimated from both ends [Wang2022]."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.estimators.base import PathTracer
from torchms.frame import Vec3
from torchms.paths.connection import balance, extend_others
from torchms.paths.segment import Invariance, Leg, Segment
from torchms.paths.vertex import Vertex, View


class Node(NamedTuple):
    """A walk after some bounces: how it sees the next facet, its weight and leg, and its other ways (see `connection`)."""

    view: View
    weight: Tensor | None
    leg: Leg
    others: Tensor | None


class Bidirectional(PathTracer):
    """Sum over all paths of up to `max_order` bounces: one walk from wi and one from wo, joined in every way.

    Every pair of sub-paths with s + t = k − 1 bounces is joined at a facet; the ways of one order are weighted by the
    balance heuristic over all of them. Unbiased for the model of the `segment`: no thresholds. Raises ValueError when it
    is put into a dielectric with `Invariance`, which knows one side of the surface only.
    """

    def __init__(self, segment: Segment, max_order: int = 8) -> None:
        if not isinstance(segment, Segment) or segment.n_uniforms:
            raise TypeError(
                f"Bidirectional(segment=...) must be Uncorrelated(), Correlated() or Invariance(); got {segment!r}."
            )
        super().__init__(segment, max_order)
        self.is_reciprocal = segment.is_reciprocal
        self.is_unbiased = isinstance(segment, Invariance) or self.max_order == 1

    def extra_repr(self) -> str:
        return f"max_order={self.max_order}"

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + 2 * self.max_order * vertex.n_uniforms

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        valid = (wi.z != 0) & (wo.z != 0) if vertex.transmits else (wi.z > 0) & (wo.z > 0)
        ahead = self._nodes(vertex, wi, u, 1)
        behind = self._nodes(vertex, wo, u, 1 + self.max_order * vertex.n_uniforms)
        join = self.segment.joiner([node.leg for node in ahead], [node.leg for node in behind], vertex.monotone)
        orders: list[Tensor] = []
        for k in range(1, self.max_order + 1):
            total: Tensor | None = None
            for s in range(k):
                t = k - 1 - s
                x, y = ahead[s], behind[t]
                crossed = None if x.view.side is None else x.view.side != y.view.side
                densities = vertex.densities(x.view, y.view, crossed)
                value = vertex.connect(x.view, y.view, crossed, densities) * join(s, t, crossed)
                share = balance(densities, x.others, y.others)
                value = value if share is None else value * share
                for weight in (x.weight, y.weight):
                    value = value if weight is None else value * weight
                total = value if total is None else total + value
            assert total is not None
            orders.append(torch.where(valid, total * wo.z.abs(), 0.0))
        return orders

    def _nodes(self, vertex: Vertex, start: Vec3, u: Sequence[Tensor], first: int) -> list[Node]:
        """The walk from `start`, a node before each bounce; its random numbers begin at `first`."""
        distribution = vertex.distribution
        w, side, _ = vertex.enter(start)
        up, weight, others, crossed = w.z < 0, None, None, None
        entered = side
        nodes: list[Node] = []
        for i in range(self.max_order):
            last = i == self.max_order - 1
            numbers = normal = None
            if not last or vertex.phase_needs_normal:
                numbers = tuple(u[first + i * vertex.n_uniforms + n] for n in range(vertex.n_uniforms))
                normal = vertex.visible_normal(w, numbers[0], numbers[1])
            view = View(w, distribution.guarded_area(w), normal, side)
            leg = Leg(distribution.blocking(-w), up, crossed, None, distribution.blocking(w))
            nodes.append(Node(view, self._weight(vertex, weight, side, entered, first), leg, others))
            if last:
                break
            assert normal is not None and numbers is not None
            bounce = vertex.sample(w, normal, numbers[2:], side)
            out = View(bounce.d, distribution.guarded_area(bounce.d), None, bounce.side)
            others = extend_others(others, vertex.densities(view, out, bounce.crossed))
            weight = bounce.weight if weight is None else weight * bounce.weight
            w, side, crossed, up = -bounce.d, bounce.side, bounce.crossed, bounce.d.z > 0
        return nodes

    def _weight(
        self, vertex: Vertex, weight: Tensor | None, side: Tensor | None, entered: Tensor | None, first: int
    ) -> Tensor | None:
        """The weight of a sub-path; one that is walked against the light carries (n_wo / n_here)² for the sides it crossed."""
        if first == 1 or side is None or entered is None or weight is None:
            return weight
        eta = vertex.relative_eta(side)
        return weight * torch.where(side == entered, 1.0, eta * eta)
