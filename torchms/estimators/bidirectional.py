"""The position-free path integral, estimated from both ends [Wang2022]."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import torch
from torch import Tensor

from torchms.estimators.path_tracer import PathTracer
from torchms.maths.frame import Vec3
from torchms.paths.connection import balance, extend_alternatives
from torchms.paths.detached import Anchors
from torchms.paths.segments import Leg, Segment
from torchms.paths.vertex import Side, Vertex, View


@dataclass(frozen=True)
class Node(Generic[Side]):
    """A walk after some bounces: its view of the next facet, its weight and its leg.

    alternatives: what the other ways to join the same path add to the weights, see `connection`.
    """

    view: View[Side]
    weight: Tensor | None
    leg: Leg
    alternatives: Tensor | None


SPREAD = ((0.0, 0.0), (0.25, 0.5), (0.5, 0.25), (0.75, 0.75))
"""What is added, modulo 1, to the two numbers of the facet that each pair of walks meets first: a net of four points."""


class Drawn:
    """The random numbers of one pair of walks, whose facets met first are spread evenly over those of all pairs.

    Orders 2 and 3 are mostly decided there. Shifted modulo 1, a uniform number is one, so every pair is as unbiased alone.
    first: where its own numbers begin; lengths: bounces of all pairs, of which the numbers of the first begin at 1; stride:
    numbers of a bounce.
    """

    def __init__(self, u: Sequence[Tensor], pair: int, first: int, lengths: Sequence[int], stride: int) -> None:
        self.u, self.pair, self.first, self.stride = u, pair, first, stride
        self.side = own_numbers(pair, lengths[pair], stride)
        self.first_side = own_numbers(0, lengths[0], stride)

    def of(self, against: bool, bounce: int, which: range) -> tuple[Tensor, ...]:
        """These of one bounce of the walk from wi, or of the one `against` the light."""
        return tuple(self._number(against, bounce, i) for i in which)

    def _number(self, against: bool, bounce: int, i: int) -> Tensor:
        if self.pair == 0 or bounce > 0 or i > 1:
            return self.u[self.first + against * self.side + bounce * self.stride + i - (2 if self.pair else 0)]
        # The same on both sides, so that a path and its reverse have the same value.
        x = self.u[1 + against * self.first_side + i] + SPREAD[self.pair][i]
        return torch.where(x >= 1, x - 1, x)


def own_numbers(pair: int, length: int, stride: int) -> int:
    """Random numbers that only one walk of a pair draws: all, but for the two of its first facet that are shifted ones."""
    return length * stride - (2 if pair else 0)


def upright(w: Vec3) -> Vec3:
    """`w`, and the normal in place of directions that are not above the horizon."""
    above = w.z > 0
    return Vec3(torch.where(above, w.x, 0.0), torch.where(above, w.y, 0.0), torch.where(above, w.z, 1.0))


class Bidirectional(PathTracer):
    """Sum over all paths of up to `max_order` bounces: one walk from wi and one from wo, joined in every way.

    Every pair of sub-paths with s + t = k − 1 bounces is joined at a facet; the ways of one order are weighted by the
    balance heuristic over all of them. One path is a few such pairs of walks, see `lengths`, which meet facets spread
    evenly at first. Unbiased for the model of the `segment`: no thresholds. `attached`: see `PathTracer`; the default is
    right. Raises ValueError when it is put into a dielectric with `Invariance`, which knows one side of the surface only:
    there `RandomHeight()`, of `torchms.paths.height`, is exact, and far less noisy than `HeightWalk`.
    """

    sources = ("Wang2022",)

    def __init__(self, segment: Segment, max_order: int = 8, attached: bool | None = None) -> None:
        if not isinstance(segment, Segment):
            raise TypeError(
                "Bidirectional(segment=...) must be Uncorrelated(), Correlated(), Invariance() or RandomHeight(); got "
                f"{segment!r}."
            )
        super().__init__(segment, max_order, attached)
        self.is_reciprocal = segment.is_reciprocal
        self.is_unbiased = segment.is_exact or (self.max_order == 1 and segment.is_exact_once)

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
        stride = self._stride(vertex)
        return 1 + 2 * sum(own_numbers(i, length, stride) for i, length in enumerate(self.lengths))

    def _stride(self, vertex: Vertex) -> int:
        """Random numbers of a bounce: those of the facet, then those of the leg that leads to it."""
        return vertex.n_uniforms + self.segment.n_uniforms

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        served = vertex.serves(wi) & vertex.serves(wo)
        if not vertex.transmits:
            # No facet may face a direction below the horizon: nothing there is divided by.
            wi, wo = upright(wi), upright(wo)
        sums: list[Tensor | None] = [None] * self.max_order
        counts = [0] * self.max_order
        first = 1
        for i, length in enumerate(self.lengths):
            drawn = Drawn(u, i, first, self.lengths, self._stride(vertex))
            # Where no facet is drawn for it, order 1 is the same number from every pair.
            lowest = 1 if counts[0] == 0 or vertex.phase_needs_normal else 2
            for k, value in self._joined(vertex, wi, wo, drawn, length, lowest).items():
                total = sums[k - 1]
                sums[k - 1] = value if total is None else total + value
                counts[k - 1] += 1
            first += 2 * drawn.side
        return [
            torch.where(served, total * (wo.z.abs() / count), 0.0)
            for total, count in zip(sums, counts, strict=True)
            if total is not None
        ]

    def _joined(
        self, vertex: Vertex[Side], wi: Vec3, wo: Vec3, drawn: Drawn, length: int, lowest: int
    ) -> dict[int, Tensor]:
        """f of the orders `lowest` … `length` from one pair of walks."""
        anchors = self._anchors(vertex, wi, wo)
        turned = None if anchors is None else tuple(-height for height in anchors)
        ahead = self._nodes(vertex, wi, drawn, length, anchors, against=False)
        behind = self._nodes(vertex, wo, drawn, length, turned, against=True)
        join = self.segment.joiner([node.leg for node in ahead], [node.leg for node in behind], vertex.monotone)
        orders: dict[int, Tensor] = {}
        for k in range(lowest, length + 1):
            for s in range(k):
                t = k - 1 - s
                x, y = ahead[s], behind[t]
                densities = vertex.densities(x.view, y.view)
                value = vertex.connect(x.view, y.view, densities)
                value = value * join(s, t, vertex.crossed(x.view.side, y.view.side))
                share = balance(densities, x.alternatives, y.alternatives)
                for factor in (share, x.weight, y.weight):
                    value = value if factor is None else value * factor
                orders[k] = orders[k] + value if k in orders else value
        return orders

    def _nodes(
        self,
        vertex: Vertex[Side],
        start: Vec3,
        drawn: Drawn,
        length: int,
        anchors: Anchors | None,
        against: bool,
    ) -> list[Node[Side]]:
        """The walk from `start`, a node before each bounce.

        A walk `against` the light weighs by (n_wo / n_here)², for the sides that it crossed.
        """
        distribution = vertex.distribution
        w, entered, _ = vertex.enter(start)
        side = entered
        up, weight, alternatives, crossed = w.z < 0, None, None, None
        nodes: list[Node[Side]] = []
        for i in range(length):
            last = i == length - 1
            numbers = normal = None
            if not last or vertex.phase_needs_normal:
                numbers = drawn.of(against, i, range(vertex.n_uniforms))
                normal = vertex.visible_normal(w, numbers[0], numbers[1])
            view = View(w, distribution.guarded_area(w), normal, side)
            heights = drawn.of(against, i, range(vertex.n_uniforms, self._stride(vertex)))
            leg = Leg(distribution.blocking(-w), up, crossed, heights, distribution.blocking(w))
            carried = weight
            if against and weight is not None:
                eta2 = vertex.relative_eta2(side, entered)
                carried = weight if eta2 is None else weight * eta2
            nodes.append(Node(view, carried, leg, alternatives))
            if last:
                break
            assert normal is not None and numbers is not None
            bounce = self._bounce(vertex, w, normal, numbers[2:], side, anchors)
            out = View(bounce.d, distribution.guarded_area(bounce.d), None, bounce.side)
            alternatives = extend_alternatives(alternatives, vertex.densities(view, out))
            weight = bounce.weight if weight is None else weight * bounce.weight
            crossed = vertex.crossed(side, bounce.side)
            w, side, up = -bounce.d, bounce.side, bounce.d.z > 0
        return nodes
