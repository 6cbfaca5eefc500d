"""Segment terms: the probability that light goes from bounce to bounce and then leaves, given its directions.

A path's directions of propagation are d_0 … d_k. With λ_l = |Λ(d_l)| = a(w_{l+1}), every term is used in its
normalised form e_k = λ_0 ⋯ λ_{k−1} · S(d_0 … d_k), the probability that a walk along these directions leaves exactly
after bounce k. It is finite at the horizon, where λ is not, and Σ_k e_k = 1 for each model, so nothing is lost.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from torchms.maths.numerics import smallest

Joiner = Callable[[int, int, Tensor | None], Tensor]


class Leg(NamedTuple):
    """One direction of propagation, in the frame of the side it runs on.

    lam: |Λ(d)|. up: whether d points above the horizon. crossed: whether the ray changed side to take this direction
    (None where no facet transmits). numbers: the `n_uniforms` uniform numbers of a model that draws heights. back: |Λ(−d)|,
    for walks that are joined with another one.
    """

    lam: Tensor
    up: Tensor
    crossed: Tensor | None = None
    numbers: tuple[Tensor, ...] = ()
    back: Tensor | None = None


class Segment(nn.Module, ABC):
    """A model of the heights between bounces; walked leg by leg with an immutable state."""

    is_reciprocal: bool
    """Whether S(d_0 … d_k) = S(−d_k … −d_0)."""
    transmits: bool
    """Whether the model holds for rays that change side."""
    is_exact: bool = False
    """Whether the term, or its expectation, is that of the Smith model."""
    is_exact_once: bool = False
    """Whether it is for a single bounce."""
    n_uniforms: int = 0
    """Random numbers a leg draws."""

    @abstractmethod
    def start(self, first: Leg, monotone: bool) -> Any:
        """State of a ray that arrives along d_0. `monotone`: no facet turns an upgoing ray down (mirrors)."""

    @abstractmethod
    def escape(self, state: Any, leg: Leg) -> Tensor:
        """e_k of the path in `state` continued by `leg` as its last direction; zero where `leg` is not up."""

    @abstractmethod
    def extend(self, state: Any, leg: Leg) -> Any:
        """State after `leg` was taken and blocked."""

    def joiner(self, forward: Sequence[Leg], backward: Sequence[Leg], monotone: bool) -> Joiner:
        """The segment terms of all paths that go s legs of `forward` and then t legs of `backward`, reversed.

        forward: d_0 … along the light from wi; backward: e_0 … along a walk from wo, so that the joined path is
        d_0 … d_s, −e_t … −e_0. The function takes s, t and whether the joining facet was crossed, and returns
        λ_0 ⋯ λ_s · μ_0 ⋯ μ_t · S with μ = |Λ(e)|: finite at the horizon.
        """
        raise TypeError(f"{type(self).__name__} has no closed segment term, so walks cannot be joined with it.")

    def forward(self, Lambda: Float[Tensor, "*batch legs"]) -> Float[Tensor, "*batch"]:
        """The segment term S of a reflected path [1], from the signed Λ(d_0) … Λ(d_k) on the last axis (k ≥ 1).

        `d_0` must point down and `d_k` up; otherwise S = 0.
        """
        if Lambda.ndim == 0 or Lambda.shape[-1] < 2:
            raise ValueError(
                f"Lambda must hold at least d_0 and d_1 on its last axis; got shape {tuple(Lambda.shape)}."
            )
        if self.n_uniforms:
            raise TypeError(f"{type(self).__name__} draws heights; it has no closed segment term.")
        legs = [Leg(x.abs(), x >= 0) for x in Lambda.unbind(-1)]
        state = self.start(legs[0], monotone=False)
        product = legs[0].lam
        for leg in legs[1:-1]:
            state = self.extend(state, leg)
            product = product * leg.lam
        return torch.where(legs[0].up, 0.0, self.escape(state, legs[-1]) / product.clamp_min(smallest(product.dtype)))
