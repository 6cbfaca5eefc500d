"""The position-free path integral, estimated from both ends [Wang2022]."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.estimators.base import PathTracer
from torchms.maths.frame import Vec3
from torchms.paths.connection import balance, extend_others
from torchms.paths.held import Knots
from torchms.paths.segments import Invariance, Leg, Segment
from torchms.paths.vertex import Vertex, View


class Node(NamedTuple):
    """A walk after some bounces: its view of the next facet, its weight and leg, its other ways (see `connection`)."""

    view: View
    weight: Tensor | None
    leg: Leg
    others: Tensor | None


def upright(w: Vec3) -> Vec3:
    """`w`, and the normal in place of directions that are not above the horizon."""
    above = w.z > 0
    return Vec3(torch.where(above, w.x, 0.0), torch.where(above, w.y, 0.0), torch.where(above, w.z, 1.0))


class Bidirectional(PathTracer):
    """Sum over all paths of up to `max_order` bounces: one walk from wi and one from wo, joined in every way.

    Every pair of sub-paths with s + t = k − 1 bounces is joined at a facet; the ways of one order are weighted by the
    balance heuristic over all of them. One path is a few such pairs of walks, see `lengths`. Unbiased for the model of
    the `segment`: no thresholds. `attached`: see `PathTracer`; the default is right. Raises ValueError when it is put
    into a dielectric with `Invariance`, which knows one side of the surface only.
    """

    def __init__(self, segment: Segment, max_order: int = 8, attached: bool | None = None) -> None:
        if not isinstance(segment, Segment) or segment.n_uniforms:
            raise TypeError(
                f"Bidirectional(segment=...) must be Uncorrelated(), Correlated() or Invariance(); got {segment!r}."
            )
        super().__init__(segment, max_order, attached)
        self.is_reciprocal = segment.is_reciprocal
        self.is_unbiased = isinstance(segment, Invariance) or self.max_order == 1

    def extra_repr(self) -> str:
        return f"max_order={self.max_order}"

    @property
    def lengths(self) -> tuple[int, ...]:
        """Bounces of each pair of walks.

        Orders 2 and 3 hold nearly all of the variance and cost least: they are the mean over four pairs of walks,
        orders 4 and 5 over two, the rest comes from one pair.
        """
        K = self.max_order
        return (K,) if K == 1 else (K, min(K, 5), min(K, 3), min(K, 3))

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + 2 * sum(self.lengths) * vertex.n_uniforms

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        valid = (wi.z != 0) & (wo.z != 0) if vertex.transmits else (wi.z > 0) & (wo.z > 0)
        if not vertex.transmits:
            # No facet may face a direction below the horizon: nothing there is divided by.
            wi, wo = upright(wi), upright(wo)
        sums: list[Tensor | None] = [None] * self.max_order
        counts = [0] * self.max_order
        first = 1
        for length in self.lengths:
            # Where no facet is drawn for it, order 1 is the same number from every pair.
            lowest = 1 if counts[0] == 0 or vertex.phase_needs_normal else 2
            for k, value in self._joined(vertex, wi, wo, u, first, length, lowest).items():
                total = sums[k - 1]
                sums[k - 1] = value if total is None else total + value
                counts[k - 1] += 1
            first += 2 * length * vertex.n_uniforms
        return [
            torch.where(valid, total * (wo.z.abs() / count), 0.0)
            for total, count in zip(sums, counts, strict=True)
            if total is not None
        ]

    def _joined(
        self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor], first: int, length: int, lowest: int
    ) -> dict[int, Tensor]:
        """f of the orders `lowest` … `length` from one pair of walks, whose random numbers begin at `first`."""
        knots = self._knots(vertex, wi, wo)
        turned = None if knots is None else tuple(-knot for knot in knots)
        ahead = self._nodes(vertex, wi, u, first, length, knots, against=False)
        behind = self._nodes(vertex, wo, u, first + length * vertex.n_uniforms, length, turned, against=True)
        join = self.segment.joiner([node.leg for node in ahead], [node.leg for node in behind], vertex.monotone)
        orders: dict[int, Tensor] = {}
        for k in range(lowest, length + 1):
            for s in range(k):
                t = k - 1 - s
                x, y = ahead[s], behind[t]
                crossed = None if x.view.side is None else x.view.side != y.view.side
                densities = vertex.densities(x.view, y.view, crossed)
                value = vertex.connect(x.view, y.view, crossed, densities) * join(s, t, crossed)
                share = balance(densities, x.others, y.others)
                for factor in (share, x.weight, y.weight):
                    value = value if factor is None else value * factor
                orders[k] = orders[k] + value if k in orders else value
        return orders

    def _nodes(
        self,
        vertex: Vertex,
        start: Vec3,
        u: Sequence[Tensor],
        first: int,
        length: int,
        knots: Knots | None,
        against: bool,
    ) -> list[Node]:
        """The walk from `start`, a node before each bounce; its random numbers begin at `first`.

        A walk `against` the light weighs by (n_wo / n_here)², for the sides that it crossed.
        """
        distribution = vertex.distribution
        w, side, _ = vertex.enter(start)
        up, weight, others, crossed = w.z < 0, None, None, None
        entered = side
        nodes: list[Node] = []
        for i in range(length):
            last = i == length - 1
            numbers = normal = None
            if not last or vertex.phase_needs_normal:
                numbers = tuple(u[first + i * vertex.n_uniforms + n] for n in range(vertex.n_uniforms))
                normal = vertex.visible_normal(w, numbers[0], numbers[1])
            view = View(w, distribution.guarded_area(w), normal, side)
            leg = Leg(distribution.blocking(-w), up, crossed, back=distribution.blocking(w))
            carried = weight
            if against and weight is not None and side is not None and entered is not None:
                eta = vertex.relative_eta(side)
                carried = weight * torch.where(side == entered, 1.0, eta * eta)
            nodes.append(Node(view, carried, leg, others))
            if last:
                break
            assert normal is not None and numbers is not None
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, knots)
            out = View(bounce.d, distribution.guarded_area(bounce.d), None, bounce.side)
            others = extend_others(others, vertex.densities(view, out, bounce.crossed))
            weight = bounce.weight if weight is None else weight * bounce.weight
            w, side, crossed, up = -bounce.d, bounce.side, bounce.crossed, bounce.d.z > 0
        return nodes
