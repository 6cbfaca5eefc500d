"""Segment terms: the probability that light goes from bounce to bounce and then leaves, given its directions.

A path's directions of propagation are d_0 … d_k. With λ_l = |Λ(d_l)| = a(w_{l+1}), every term is used in its normalised
form e_k = λ_0 ⋯ λ_{k−1} · S(d_0 … d_k), the probability that a walk along these directions leaves exactly after bounce k.
It is finite at the horizon, where λ is not, and Σ_k e_k = 1 for each model, so nothing is lost.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from torchms.masking import escape_correlated, escape_transmitted, escape_uncorrelated
from torchms.numerics import expm1, log1p, safe_div
from torchms.special import log_beta_step
from torchms.typing import Scalar


class Leg(NamedTuple):
    """One direction of propagation, in the frame of the side it runs on.

    lam: |Λ(d)|. up: whether d points above the horizon. crossed: whether the ray changed side to take this direction
    (None where no facet transmits). number: a uniform number for models that draw a height, else None.
    """

    lam: Tensor
    up: Tensor
    crossed: Tensor | None = None
    number: Tensor | None = None


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

    def forward(self, Lambda: Scalar) -> Scalar:
        """The segment term S of a reflected path [1], from the signed Λ(d_0) … Λ(d_k) on the last axis (k ≥ 1).

        `d_0` must point down and `d_k` up; otherwise S = 0.
        """
        if Lambda.ndim == 0 or Lambda.shape[-1] < 2:
            raise ValueError(f"Lambda must hold at least d_0 and d_1 on its last axis; got shape {tuple(Lambda.shape)}.")
        legs = [Leg(x.abs(), x >= 0) for x in Lambda.unbind(-1)]
        if any(leg.number is None for leg in legs) and self.n_uniforms:
            raise TypeError(f"{type(self).__name__} draws heights; it has no closed segment term.")
        state = self.start(legs[0], monotone=False)
        product = legs[0].lam
        for leg in legs[1:-1]:
            state = self.extend(state, leg)
            product = product * leg.lam
        return torch.where(legs[0].up, 0.0, safe_div(self.escape(state, legs[-1]), product))


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


class InvarianceState(NamedTuple):
    legs: tuple[Leg, ...]
    columns: tuple[tuple[Tensor, ...], ...]
    """columns[j][i] is the normalised term of the sub-path d_i … d_j, i < j."""
    monotone: bool


class Invariance(Segment):
    """The exact term of the Smith model, for facets that reflect. Reciprocal.

    A path is split at its highest collision; both halves are paths of the same kind (THEORY section 4):
    S(i…j) = 1 / (|Λ_i| + Λ_j) · Σ_m S(i…m) S(m+1…j), zero unless d_i points down and d_j up; one-direction halves count 1.
    Mirrors never turn an upgoing ray down, so only the two outer splits survive: the recursion of [Cui2023].
    """

    is_reciprocal = True
    transmits = False

    def start(self, first: Leg, monotone: bool) -> InvarianceState:
        return InvarianceState((first,), ((),), monotone)

    def escape(self, state: InvarianceState, leg: Leg) -> Tensor:
        return self._column(state, leg)[0]

    def extend(self, state: InvarianceState, leg: Leg) -> InvarianceState:
        return InvarianceState(
            (*state.legs, leg), (*state.columns, self._column(state, leg)), state.monotone
        )

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
            # d_0 always points down: it is where the light comes from.
            counts = leg.up if i == 0 else leg.up & ~legs[i].up
            below = torch.where(counts, legs[i].lam + leg.lam, 1.0)
            column[i] = torch.where(counts, total / below, 0.0)
        return tuple(column)


class HeightState(NamedTuple):
    stay: Tensor
    log_U: Tensor


class RandomHeight(Segment):
    """The height itself is carried along, as U = C1(h), and drawn anew on every leg [Heitz2016].

    Not a closed term but an unbiased estimate of one: the escape at each bounce is its probability U^Λ(d), and the next
    height is drawn given that the ray stayed. U becomes 1 − U when the ray changes side.
    """

    is_reciprocal = True
    transmits = True
    n_uniforms = 1

    def start(self, first: Leg, monotone: bool) -> HeightState:
        # The ray enters from above all heights, U = 1, going down, and collides at U = (1 − u)^(1 / |Λ|).
        return self._descend(HeightState(torch.ones_like(first.lam), torch.zeros_like(first.lam)), first)

    def escape(self, state: HeightState, leg: Leg) -> Tensor:
        log_U = self._on_side_of(leg, state.log_U)
        return torch.where(leg.up, state.stay * torch.exp(leg.lam * log_U), 0.0)

    def extend(self, state: HeightState, leg: Leg) -> HeightState:
        return self._descend(HeightState(state.stay, self._on_side_of(leg, state.log_U)), leg)

    def _on_side_of(self, leg: Leg, log_U: Tensor) -> Tensor:
        if leg.crossed is None:
            return log_U
        # ln(1 − U), kept finite at U = 1.
        other = log1p(-torch.exp(log_U.clamp_max(-torch.finfo(log_U.dtype).eps)))
        return torch.where(leg.crossed, other, log_U)

    def _descend(self, state: HeightState, leg: Leg) -> HeightState:
        """Collide somewhere along `leg`: U' = U · q^(∓1 / Λ), where q is uniform in (U^Λ, 1) going up, in (0, 1) down."""
        assert leg.number is not None
        lam = leg.lam.clamp_min(1e-12)
        blocked = torch.where(leg.up, -expm1(lam * state.log_U), 1.0)
        step = log1p(-leg.number * blocked) / lam
        return HeightState(state.stay * blocked, (state.log_U + torch.where(leg.up, -step, step)).clamp_max(0.0))
