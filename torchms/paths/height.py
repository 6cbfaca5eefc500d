"""The segment that draws its heights: the walk of [Heitz2016], leg by leg."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.numerics import expm1, log1p
from torchms.paths.segments.base import Joiner, Leg, Segment

LEAST = 1e-12
"""Smallest |Λ| that a height is drawn with."""


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
    is_exact = True
    n_uniforms = 1

    def start(self, first: Leg, monotone: bool) -> HeightState:
        # The ray enters from above all heights, U = 1, going down, and collides at U = (1 − u)^(1 / |Λ|).
        return self._descend(HeightState(torch.ones_like(first.lam), torch.zeros_like(first.lam)), first)

    def escape(self, state: HeightState, leg: Leg) -> Tensor:
        log_U = self._on_side_of(leg, state.log_U)
        return torch.where(leg.up, state.stay * torch.exp(leg.lam * log_U), 0.0)

    def extend(self, state: HeightState, leg: Leg) -> HeightState:
        return self._descend(HeightState(state.stay, self._on_side_of(leg, state.log_U)), leg)

    def joiner(self, forward: Sequence[Leg], backward: Sequence[Leg], monotone: bool) -> Joiner:
        """Heights are drawn along the joined path, with the numbers of the legs of either walk."""
        states = [self.start(forward[0], monotone)]
        for leg in forward[1:]:
            states.append(self.extend(states[-1], leg))

        def joined(s: int, t: int, crossed: Tensor | None) -> Tensor:
            state, ratio = states[s], backward[0].lam
            for i in range(t, 0, -1):
                leg = backward[i]
                assert leg.back is not None
                state = self.extend(state, Leg(leg.back, ~leg.up, crossed, leg.numbers))
                # The legs of the other walk have brought |Λ(e_i)| in place of |Λ(−e_i)|.
                ratio, crossed = ratio * (leg.lam / leg.back.clamp_min(LEAST)), leg.crossed
            back = backward[0].back
            assert back is not None
            return self.escape(state, Leg(back, ~backward[0].up, crossed)) * ratio

        return joined

    def _on_side_of(self, leg: Leg, log_U: Tensor) -> Tensor:
        if leg.crossed is None:
            return log_U
        return torch.where(leg.crossed, self._other_side(log_U), log_U)

    def _other_side(self, log_U: Tensor) -> Tensor:
        """ln(1 − U), kept finite at U = 1. Light that grazes collides where U is next to 1, and 1 − U would cancel."""
        log_U = log_U.clamp_max(-(torch.finfo(log_U.dtype).eps ** 2))
        high = log_U > -math.log(2)
        near, far = torch.where(high, log_U, -1.0), torch.where(high, -1.0, log_U)
        return torch.where(high, torch.log(-expm1(near)), log1p(-torch.exp(far)))

    def _descend(self, state: HeightState, leg: Leg) -> HeightState:
        """Collide somewhere along `leg`: U' = U · q^(∓1 / Λ), q uniform in (U^Λ, 1) going up, in (0, 1) going down."""
        (number,) = leg.numbers
        lam = leg.lam.clamp_min(LEAST)
        blocked = torch.where(leg.up, -expm1(lam * state.log_U), 1.0)
        # A number that was rounded up to 1 counts as the last one below.
        passed = (number * blocked).clamp_max(1 - torch.finfo(lam.dtype).eps / 2)
        step = log1p(-passed) / lam
        return HeightState(state.stay * blocked, (state.log_U + torch.where(leg.up, -step, step)).clamp_max(0.0))
