"""The networks of a correction: ln of what Smith's lobe of each order is off by, of a pair of directions and of each."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.approximations.distil.squares import Net
from torchms.approximations.distil.weights import Inputs
from torchms.approximations.network import Layer
from torchms.approximations.surface_correction import MOST, ORDERS

Folded = tuple[list[Layer], Tensor]
"""Layers and the linear part, for features as they are."""


class Correction:
    """Shapes of both networks within one flat vector, and the features' means and spreads."""

    def __init__(self, widths: Sequence[int], each: Sequence[int], inputs: Inputs) -> None:
        self.pair = Net([inputs.pair.shape[1], *widths, ORDERS])
        self.each = Net([inputs.one.shape[1], *each, ORDERS])
        one = torch.cat([inputs.one, inputs.other])
        self.mean, self.spread = inputs.pair.mean(0), _spread(inputs.pair)
        self.mean_of_one, self.spread_of_one = one.mean(0), _spread(one)

    def standardised(self, inputs: Inputs) -> Inputs:
        """The inputs with mean 0 and spread 1; a feature that does not vary is 0."""
        one, other = ((x - self.mean_of_one) / self.spread_of_one for x in (inputs.one, inputs.other))
        return Inputs((inputs.pair - self.mean) / self.spread, one, other)

    def initial(self, generator: torch.Generator) -> Tensor:
        """A vector to begin with: no correction."""
        return torch.cat([net.initial([0.0] * ORDERS, generator) for net in (self.pair, self.each)])

    def parts(self, vector: Tensor) -> tuple[Tensor, Tensor]:
        """The numbers of either network."""
        return vector[: self.pair.length], vector[self.pair.length :]

    def outputs(self, vector: Tensor, inputs: Inputs) -> Tensor:
        """c_k (n, ORDERS) of standardised features."""
        pair, each = self.parts(vector)
        found = self.pair.outputs(pair, inputs.pair)
        return (found + (self.each.outputs(each, inputs.one) + self.each.outputs(each, inputs.other))).clamp(
            -MOST, MOST
        )

    def folded(self, vector: Tensor) -> tuple[Folded, Folded]:
        """Both networks for features as they are."""
        pair, each = self.parts(vector)
        return (
            self.pair.folded(pair, self.mean, self.spread),
            self.each.folded(each, self.mean_of_one, self.spread_of_one),
        )


def _spread(x: Tensor) -> Tensor:
    found = x.std(0)
    return torch.where(found > 1e-5 * (1 + x.mean(0).abs()), found, torch.ones_like(found))
