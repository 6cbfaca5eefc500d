"""The level of a lobe in training, with its derivatives by the weights."""

from itertools import pairwise

import torch
from torch import Tensor

from torchms.approximations.distil.weights import Inputs, Net, Weights


class Level:
    """ln g of the networks and its derivatives by the numbers that it depends on."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        sizes = weights.sizes
        places, at = [], 0
        for n, m in pairwise(sizes[:-1]):
            places.append(torch.arange(at, at + m * n + m))
            at += m * n + m
        n, m = sizes[-2:]
        # Of the last layer of pairs: the first row, and its offset; then the linear part. Of each direction: all.
        places += [torch.arange(at, at + n), torch.tensor([at + m * n])]
        each = sum(m * n + m for n, m in pairwise(weights.each)) + weights.each[0]
        places.append(torch.arange(weights.length - sizes[0], weights.length + each))
        self.places = torch.cat(places)

    def value(self, vector: Tensor, inputs: Inputs) -> Tensor:
        """g (n)."""
        return torch.exp(self.weights.outputs(vector, inputs)[:, 0].clamp(*self.weights.exponent))

    def derivatives(self, vector: Tensor, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """g (n) and d ln g / d vector (n, len(places))."""
        pair, each = self.weights.split(vector)
        level, columns = self._derivatives(pair, inputs.pair)
        one, of_one = self._derivatives(each, inputs.one)
        other, of_other = self._derivatives(each, inputs.other)
        level, columns = level + one + other, torch.cat([columns, of_one + of_other], 1)
        low, high = self.weights.exponent
        inside = (level > low) & (level < high)
        return torch.exp(level.clamp(low, high)), columns * inside[:, None]

    def _derivatives(self, net: Net, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """The first output (n), and its derivatives by all that it depends on, in the order of the vector."""
        (layers, skip), activation = net, self.weights.activation
        x, seen, slopes = inputs, [], []
        for weight, offset in layers[:-1]:
            z = torch.addmm(offset, x, weight.T)
            seen.append(x)
            slopes.append(activation.slope(z))
            x = activation.value(z)
        weight, offset = layers[-1]
        found = x @ weight[0] + offset[0] + inputs @ skip
        columns = [inputs, torch.ones_like(found)[:, None], x]
        back = weight[0].expand_as(x)
        for k in range(len(layers) - 2, -1, -1):
            back = back * slopes[k]
            columns.append(back)
            columns.append((back[:, :, None] * seen[k][:, None, :]).flatten(1))
            back = back @ layers[k][0]
        return found, torch.cat(columns[::-1], 1)
