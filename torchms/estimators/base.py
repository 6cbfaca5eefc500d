"""What stands in a BSDF's `scattering` slot: an estimator, or an approximation, of the sum over bounces."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from torch import Tensor, nn

from torchms.maths.frame import Vec3
from torchms.paths.segments.base import Segment
from torchms.paths.vertex import Vertex
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


def check_scattering(value: object, owner: str) -> None:
    """Raise TypeError if `value` cannot stand in the slot of the surface `owner`, with what to write instead."""
    if isinstance(value, Scattering):
        return
    remedy = ""
    if isinstance(value, Segment):
        remedy = f" Write Bidirectional({value!r}): a segment says how bounces are linked, not how they are summed."
    elif isinstance(value, type) and issubclass(value, Scattering | Segment):
        remedy = f" Write {value.__name__}(), with the brackets."
    raise TypeError(
        f"{owner}(scattering=...) must be HeightWalk(...), Bidirectional(...) or the like; got {value!r}.{remedy}"
    )
