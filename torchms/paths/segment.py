"""Segment terms: the probability that light goes from bounce to bounce and then leaves, given its directions.

A path's directions of propagation are d_0 … d_k. With λ_l = |Λ(d_l)| = a(w_{l+1}), every term is used in its
normalised form e_k = λ_0 ⋯ λ_{k−1} · S(d_0 … d_k), the probability that a walk along these directions leaves exactly
after bounce k. It is finite at the horizon, where λ is not, and Σ_k e_k = 1 for each model, so nothing is lost.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from torchms.masking import escape_correlated, escape_transmitted, escape_uncorrelated
from torchms.numerics import expm1, safe_div, smallest
from torchms.special import log_beta_step

Joiner = Callable[[int, int, Tensor | None], Tensor]


class Leg(NamedTuple):
    """One direction of propagation, in the frame of the side it runs on.

    lam: |Λ(d)|. up: whether d points above the horizon. crossed: whether the ray changed side to take this direction
    (None where no facet transmits). number: a uniform number for models that draw a height, else None. back: |Λ(−d)|,
    for walks that are joined with another one.
    """

    lam: Tensor
    up: Tensor
    crossed: Tensor | None = None
    number: Tensor | None = None
    back: Tensor | None = None


class Segment(nn.Module):
    """A model of the heights between bounces; walked leg by leg with an immutable state."""

    is_reciprocal: bool
    """Whether S(d_0 … d_k) = S(−d_k … −d_0)."""
    transmits: bool
    """Whether the model holds for rays that change side."""
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
        legs = [Leg(x.abs(), x >= 0) for x in Lambda.unbind(-1)]
        if any(leg.number is None for leg in legs) and self.n_uniforms:
            raise TypeError(f"{type(self).__name__} draws heights; it has no closed segment term.")
        state = self.start(legs[0], monotone=False)
        product = legs[0].lam
        for leg in legs[1:-1]:
            state = self.extend(state, leg)
            product = product * leg.lam
        return torch.where(legs[0].up, 0.0, self.escape(state, legs[-1]) / product.clamp_min(smallest(product.dtype)))


class Uncorrelated(Segment):
    """Each leg is judged by itself, as if every bounce happened at a fresh height [Wang2022, §2.1]. Reciprocal."""

    is_reciprocal = True
    transmits = True

    def start(self, first: Leg, monotone: bool) -> Tensor:
        return torch.ones_like(first.lam)

    def escape(self, state: Tensor, leg: Leg) -> Tensor:
        return torch.where(leg.up, state * escape_uncorrelated(leg.lam), 0.0)

    def extend(self, state: Tensor, leg: Leg) -> Tensor:
        return state * torch.where(leg.up, leg.lam / (1 + leg.lam), 1.0)

    def joiner(self, forward: Sequence[Leg], backward: Sequence[Leg], monotone: bool) -> Joiner:
        # Every direction has a factor of its own, the same read from either end; those of wi and wo cancel.
        ahead, behind = self._products(forward, monotone), self._products(backward, monotone)
        return lambda s, t, crossed: ahead[s] * behind[t]

    def _products(self, legs: Sequence[Leg], monotone: bool) -> list[Tensor]:
        states = [self.start(legs[0], monotone)]
        for leg in legs[1:]:
            states.append(self.extend(states[-1], leg))
        return states


class CorrelatedState(NamedTuple):
    stay: Tensor
    a: Tensor


class Correlated(Segment):
    """A leg's height is that of the bounce it comes from, which is drawn afresh at each bounce [Wang2022, §1.2–1.3].

    Not reciprocal [Wang2022, Eqs. 25–26].
    """

    is_reciprocal = False
    transmits = True

    def start(self, first: Leg, monotone: bool) -> CorrelatedState:
        return CorrelatedState(torch.ones_like(first.lam), first.lam)

    def escape(self, state: CorrelatedState, leg: Leg) -> Tensor:
        leaves = escape_correlated(state.a, leg.lam)
        if leg.crossed is not None:
            leaves = torch.where(leg.crossed, escape_transmitted(state.a, leg.lam), leaves)
        return torch.where(leg.up, state.stay * leaves, 0.0)

    def extend(self, state: CorrelatedState, leg: Leg) -> CorrelatedState:
        # 1 − a / (a + Λ) and 1 − a B(a, 1 + Λ), without cancellation.
        stays = safe_div(leg.lam, state.a + leg.lam)
        if leg.crossed is not None:
            stays = torch.where(leg.crossed, -expm1(log_beta_step(state.a, leg.lam)), stays)
        return CorrelatedState(state.stay * torch.where(leg.up, stays, 1.0), leg.lam)

    def joiner(self, forward: Sequence[Leg], backward: Sequence[Leg], monotone: bool) -> Joiner:
        # With a_l = λ_{l−1}, λ_0 ⋯ λ_{k−1} · S = stay_1 ⋯ stay_{k−1} · escape_k. The legs that come from the other walk
        # have brought μ_t ⋯ μ_0 instead of the λ of the same directions.
        states = [self.start(forward[0], monotone)]
        for leg in forward[1:]:
            states.append(self.extend(states[-1], leg))
        behind = [torch.ones_like(backward[0].lam)]
        for i in range(1, len(backward)):
            came_from = backward[i].back
            assert came_from is not None
            further = behind[-1] * self._reversed_leg(came_from, backward, i - 1, backward[i].crossed)
            # A long product of large ratios overflows where the weight that it meets is next to 0.
            behind.append(further.clamp_max(1 / smallest(further.dtype)))
        return lambda s, t, crossed: states[s].stay * self._reversed_leg(states[s].a, backward, t, crossed) * behind[t]

    def _reversed_leg(self, a: Tensor, backward: Sequence[Leg], i: int, crossed: Tensor | None) -> Tensor:
        """The factor of direction −e_i, reached from a facet with a(w) = `a`, times μ_i and, if i > 0, / |Λ(−e_i)|."""
        leg = backward[i]
        assert leg.back is not None
        if i == 0:
            leaves = escape_correlated(a, leg.back)
            if crossed is not None:
                leaves = torch.where(crossed, escape_transmitted(a, leg.back), leaves)
            return leg.lam * leaves
        stays = safe_div(leg.lam, a + leg.back)
        if crossed is not None:
            through = -expm1(log_beta_step(a, leg.back))
            stays = torch.where(crossed, safe_div(leg.lam * through, leg.back), stays)
        # −e_i points up where e_i points down.
        return torch.where(leg.up, safe_div(leg.lam, leg.back), stays)


class InvarianceState(NamedTuple):
    legs: tuple[Leg, ...]
    columns: tuple[tuple[Tensor, ...], ...]
    """columns[j][i] is the normalised term of the sub-path d_i … d_j, i < j."""
    monotone: bool


class Invariance(Segment):
    """The exact term of the Smith model, for facets that reflect. Reciprocal.

    A path is split at its highest collision; both halves are paths of the same kind (THEORY section 4):
    S(i…j) = 1 / (|Λ_i| + Λ_j) · Σ_m S(i…m) S(m+1…j), zero unless d_i points down and d_j up; halves of one direction
    count 1. Mirrors never turn an upgoing ray down, so only the two outer splits survive: the recursion of [Cui2023].
    """

    is_reciprocal = True
    transmits = False

    def start(self, first: Leg, monotone: bool) -> InvarianceState:
        return InvarianceState((first,), ((),), monotone)

    def escape(self, state: InvarianceState, leg: Leg) -> Tensor:
        return self._column(state, leg)[0]

    def extend(self, state: InvarianceState, leg: Leg) -> InvarianceState:
        return InvarianceState((*state.legs, leg), (*state.columns, self._column(state, leg)), state.monotone)

    def joiner(self, forward: Sequence[Leg], backward: Sequence[Leg], monotone: bool) -> Joiner:
        # The term is reciprocal, so that sub-paths within either walk are its own columns. What crosses the join is
        # T(i, a) = λ_i ⋯ λ_s · μ_a ⋯ μ_t · S(d_i … d_s, −e_t … −e_a), from the inside out. What a cell is multiplied by
        # does not depend on where the walks are joined.
        ahead, behind = self._columns(forward, monotone), self._columns(backward, monotone)
        weights: dict[tuple[int, int], Tensor] = {}

        def weight(i: int, a: int) -> Tensor:
            """1 / (λ_i + Λ(−e_a)), zero unless d_i and e_a both point down."""
            if (i, a) not in weights:
                back = backward[a].back
                assert back is not None
                below = forward[i].lam + back
                downward = [~leg.up for leg, index in ((forward[i], i), (backward[a], a)) if index > 0]
                if downward:
                    counts = downward[0] if len(downward) == 1 else downward[0] & downward[1]
                    weights[i, a] = torch.where(counts, 1 / torch.where(counts, below, 1.0), 0.0)
                else:
                    weights[i, a] = 1 / below
            return weights[i, a]

        def join(s: int, t: int, crossed: Tensor | None) -> Tensor:
            cells: dict[tuple[int, int], Tensor] = {}
            last = forward[s].lam * backward[t].lam
            for i in range(s, -1, -1):
                for a in range(t, -1, -1):
                    total = None
                    # Splits behind d_m in the first walk; the one behind d_s parts the two walks.
                    for m in range(i, s + 1) if not monotone else sorted({i, s} if a == t else {i}):
                        term = forward[m].lam * cells[m + 1, a] if m < s else last
                        if m == s and a < t:
                            term = term * behind[t][a]
                        if m > i:
                            term = term * ahead[m][i]
                        total = term if total is None else total + term
                    # Splits behind −e_b in the second walk.
                    for b in range(a + 1, t + 1) if not monotone else range(a + 1, min(a + 2, t + 1)):
                        term = backward[b - 1].lam * cells[i, b]
                        if b - 1 > a:
                            term = term * behind[b - 1][a]
                        total = term if total is None else total + term
                    assert total is not None
                    cells[i, a] = weight(i, a) * total
            return cells[0, 0]

        return join

    def _columns(self, legs: Sequence[Leg], monotone: bool) -> tuple[tuple[Tensor, ...], ...]:
        state = self.start(legs[0], monotone)
        for leg in legs[1:]:
            state = self.extend(state, leg)
        return state.columns

    def _column(self, state: InvarianceState, leg: Leg) -> tuple[Tensor, ...]:
        """The normalised terms of d_i … d_{j−1}, leg for every i.

        Normalised by λ_i ⋯ λ_{j−1}, the recursion reads e(i,j) = 1 / (λ_i + λ_j) · Σ_m λ_m e(i,m) e(m+1,j).
        """
        legs, columns = state.legs, state.columns
        j = len(legs)
        column: list[Tensor] = [leg.lam] * j
        for i in range(j - 1, -1, -1):
            splits = range(i, j) if not state.monotone or i == j - 1 else (i, j - 1)
            total = None
            for m in splits:
                term = legs[m].lam
                if m > i:
                    term = term * columns[m][i]
                if m < j - 1:
                    term = term * column[m + 1]
                total = term if total is None else total + term
            assert total is not None
            counts = leg.up & ~legs[i].up
            below = torch.where(counts, legs[i].lam + leg.lam, 1.0)
            column[i] = torch.where(counts, total / below, 0.0)
        return tuple(column)
