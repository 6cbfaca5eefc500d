"""The networks of a training: one flat vector of numbers, whose inputs have mean 0 and spread 1."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.activations import SOFT, Activation
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.metal_lobes import EXPONENT, OUTPUTS, heads
from torchms.approximations.network import Layer, folded
from torchms.sampling.uniforms import draw

Net = tuple[list[Layer], Tensor]
"""Layers, and the linear part of the first output."""


class Inputs(NamedTuple):
    """Features of n pairs, and of the one and the other direction of each; (n, features)."""

    pair: Tensor
    one: Tensor
    other: Tensor

    def part(self, rows: slice) -> "Inputs":
        """Some of them."""
        return Inputs(*(x[rows] for x in self))

    def split(self, size: int) -> Iterator["Inputs"]:
        """All of them, `size` at a time."""
        for parts in zip(*(x.split(size) for x in self), strict=True):
            yield Inputs(*parts)


class Heads:
    """What the outputs (n, OUTPUTS) of the networks mean; the training's counterpart of `MetalLobes.rest`."""

    def __init__(self, outputs: Tensor) -> None:
        level, *others = outputs.unbind(-1)
        self.level = torch.exp(level.clamp(*EXPONENT))
        a, b, fall = heads(others)
        last = 1 / (1 + a + b)
        self.shares = torch.stack([a * last, b * last, last], -1)
        self.rest = fall / (1 - fall)
        """Mean number of bounces after the fourth, of light that has come to it."""


class Weights:
    """Shapes of the layers within the vector, and the map between it and what a file holds.

    The pair's network comes first, then that of each direction; each has its layers, then the linear part. exponent: range
    of the first output, whose mean is `start` to begin with.
    """

    def __init__(
        self,
        widths: Sequence[int],
        each: Sequence[int],
        inputs: Inputs,
        outputs: int = OUTPUTS,
        exponent: tuple[float, float] = EXPONENT,
        start: float = -3.0,
        activation: Activation = SOFT,
    ) -> None:
        self.sizes = [inputs.pair.shape[1], *widths, outputs]
        self.each = [inputs.one.shape[1], *each, 1]
        self.exponent, self.start, self.activation = exponent, start, activation
        self.length = _length(self.sizes)
        one = torch.cat([inputs.one, inputs.other])
        self.mean, self.spread = inputs.pair.mean(0), inputs.pair.std(0)
        self.mean_of_one, self.spread_of_one = one.mean(0), one.std(0)

    def standardised(self, inputs: Inputs) -> Inputs:
        """The inputs with mean 0 and spread 1."""
        one, other = ((x - self.mean_of_one) / self.spread_of_one for x in (inputs.one, inputs.other))
        return Inputs((inputs.pair - self.mean) / self.spread, one, other)

    def initial(self, generator: torch.Generator) -> Tensor:
        """A vector to begin with."""
        parts = []
        for sizes, size, level in ((self.sizes, 0.3, self.start), (self.each, 0.1, 0.0)):
            for k, (n, m) in enumerate(pairwise(sizes)):
                last = k == len(sizes) - 2
                # Uniform numbers of that standard deviation.
                weight = (2 * draw((m * n + m,), 1, 1, generator=generator).flatten() - 1) * math.sqrt(3)
                weight[: m * n] *= (size if last else 1.2) / math.sqrt(n)
                weight[m * n :] *= 0.0 if last else 0.5
                if last:
                    weight[m * n] = level
                parts.append(weight)
            parts.append(torch.zeros(sizes[0]))
        return torch.cat(parts)

    def unfolded(self, distillate: Distillate) -> Tensor:
        """The vector of what a file holds: of the linear parts only that of ln g is kept."""
        assert distillate.each is not None
        parts = []
        for net, mean, spread in (
            ((distillate.layers, distillate.skip), self.mean, self.spread),
            (distillate.each, self.mean_of_one, self.spread_of_one),
        ):
            layers, skip = [(w.double(), b.double()) for w, b in net[0]], net[1].double()
            layers[-1] = layers[-1][0], layers[-1][1] + skip @ mean.double()
            layers[0] = layers[0][0] * spread, layers[0][1] + layers[0][0] @ mean.double()
            parts += [x.flatten() for layer in layers for x in layer] + [skip[0] * spread]
        return torch.cat(parts).float()

    def begin_with(self, vector: Tensor, distillate: Distillate) -> None:
        """Put the networks of a file into `vector`, which has as many units or more: these say nothing yet.

        ValueError if it has fewer.
        """
        begun = self.unfolded(distillate)
        pair, each = (
            [n, *units, m] for (n, *_, m), units in zip((self.sizes, self.each), sizes_of(distillate), strict=True)
        )
        for name, mine, its in (("widths", self.sizes, pair), ("each", self.each, each)):
            if len(its) != len(mine) or any(a < b for a, b in zip(mine, its, strict=True)):
                raise ValueError(f"--packaged: those networks have {its[1:-1]} units; got --{name} {mine[1:-1]}.")
        length = _length(pair)
        for net, sizes, old in zip(self.split(vector), (pair, each), (begun[:length], begun[length:]), strict=True):
            _begin(net, _layers(old, sizes))

    def split(self, vector: Tensor) -> tuple[Net, Net]:
        """The networks of the pair and of each direction."""
        return _layers(vector[: self.length], self.sizes), _layers(vector[self.length :], self.each)

    def outputs(self, vector: Tensor, inputs: Inputs) -> Tensor:
        """The outputs (n, K) for standardised features."""
        pair, each = self.split(vector)
        found = self._outputs(pair, inputs.pair)
        of_one = self._outputs(each, inputs.one) + self._outputs(each, inputs.other)
        return torch.cat([found[:, :1] + of_one, found[:, 1:]], 1)

    def hidden(self, layers: list[Layer], x: Tensor) -> Tensor:
        """What the last of the layers takes."""
        for weight, offset in layers[:-1]:
            x = self.activation.value(torch.addmm(offset, x, weight.T))
        return x

    def _outputs(self, net: Net, inputs: Tensor) -> Tensor:
        """The outputs (n, K) of one network; its linear part is added to the first."""
        layers, skip = net
        weight, offset = layers[-1]
        found = torch.addmm(offset, self.hidden(layers, inputs), weight.T)
        return torch.cat([found[:, :1] + (inputs @ skip)[:, None], found[:, 1:]], 1)

    def folded(self, vector: Tensor, others: Net | None = None) -> tuple[Net, Net]:
        """Both networks for features as they are; the linear parts (outputs, features).

        others: last layer and linear part of all outputs but the first, in place of those in the vector.
        """
        pair, each = self.split(vector.detach().double())
        layers, skip = pair
        skip = torch.cat([skip[None], torch.zeros(self.sizes[-1] - 1, self.sizes[0], dtype=skip.dtype)])
        if others is not None:
            ((weight, offset),), skip[1:] = others
            layers[-1][0][1:], layers[-1][1][1:] = weight, offset
        pair, each = (layers, skip), (each[0], each[1][None])
        return folded(*pair, self.mean, self.spread), folded(*each, self.mean_of_one, self.spread_of_one)


def sizes_of(distillate: Distillate) -> tuple[list[int], list[int]]:
    """Units of the hidden layers of both networks of a file."""
    assert distillate.each is not None
    pair, each = ([len(offset) for _, offset in layers[:-1]] for layers in (distillate.layers, distillate.each[0]))
    return pair, each


def _length(sizes: Sequence[int]) -> int:
    """Numbers of one network."""
    return sum(m * n + m for n, m in pairwise(sizes)) + sizes[0]


def _begin(net: Net, old: Net) -> None:
    """Write `old` into the first units of `net`; what its further units say is not heard by any layer behind them."""
    (layers, skip), (before, linear) = net, old
    for (weight, offset), (w, b) in zip(layers, before, strict=True):
        weight[: len(b)] = 0
        weight[: len(b), : w.shape[1]] = w
        offset[: len(b)] = b
    skip.copy_(linear)


def _layers(vector: Tensor, sizes: Sequence[int]) -> Net:
    layers, at = [], 0
    for n, m in pairwise(sizes):
        layers.append((vector[at : at + m * n].view(m, n), vector[at + m * n : at + m * n + m]))
        at += m * n + m
    return layers, vector[at:]
