"""Heights that are fresh at every bounce [Wang2022]."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.numerics import expm1, safe_div, smallest
from torchms.maths.special import log_beta_step
from torchms.paths.masking import escape_correlated, escape_transmitted
from torchms.paths.segments.base import Joiner, Leg, Segment


class CorrelatedState(NamedTuple):
    stay: Tensor
    a: Tensor


class Correlated(Segment):
    """A leg's height is that of the bounce it comes from, which is drawn afresh at each bounce [Wang2022, §1.2–1.3].

    Not reciprocal [Wang2022, Eqs. 25–26].
    """

    sources = ("Wang2022",)

    is_reciprocal = False
    transmits = True
    is_exact_once = True

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
