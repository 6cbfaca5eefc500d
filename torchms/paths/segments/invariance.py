"""Heights that are carried exactly, by the invariance principle [Cui2023]."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.paths.segments.base import Joiner, Leg, Segment


class InvarianceState(NamedTuple):
    legs: tuple[Leg, ...]
    columns: tuple[tuple[Tensor, ...], ...]
    """columns[j][i] is the normalised term of the sub-path d_i … d_j, i < j."""
    monotone: bool


class Invariance(Segment):
    """The exact term of the Smith model, for facets that reflect. Reciprocal.

    A path is split at its highest collision; both halves are paths of the same kind (docs/theory.md, section 4):
    S(i…j) = 1 / (|Λ_i| + Λ_j) · Σ_m S(i…m) S(m+1…j), zero unless d_i points down and d_j up; halves of one direction
    count 1. Mirrors never turn an upgoing ray down, so only the two outer splits survive: the recursion of [Cui2023].
    """

    sources = ("Cui2023",)

    is_reciprocal = True
    transmits = False
    is_exact = True

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
