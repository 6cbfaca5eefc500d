"""Heights that are fresh at every leg [Wang2022]."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.paths.masking import escape_uncorrelated
from torchms.paths.segments.base import Joiner, Leg, Segment


class Uncorrelated(Segment):
    """Each leg is judged by itself, as if every bounce happened at a fresh height [Wang2022, §2.1]. Reciprocal."""

    sources = ("Wang2022",)

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
