"""Levenberg–Marquardt for a small network of several outputs, with a linear part beside it."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.activations import ROOT
from torchms.approximations.network import Layer, folded
from torchms.sampling.uniforms import draw

CHUNK = 4096
"""Rows whose derivatives are held at a time."""
LEAST = 1e-8
"""Smallest damping."""
TRIES = 6


class Traced(NamedTuple):
    """Outputs (n, K) of the network, and what their derivatives are made of: inputs and slopes of each layer."""

    outputs: Tensor
    seen: list[Tensor]
    slopes: list[Tensor]


class Net:
    """Shapes of the layers within one flat vector; the inputs are standardised."""

    def __init__(self, sizes: Sequence[int]) -> None:
        self.sizes = tuple(sizes)
        self.shapes = [(m, n) for n, m in pairwise(self.sizes)]
        self.length = sum(m * n + m for m, n in self.shapes) + self.sizes[0] * self.sizes[-1]

    def initial(self, offsets: Sequence[float], generator: torch.Generator) -> Tensor:
        """A vector to begin with: random hidden layers, and outputs that are these `offsets`."""
        parts = []
        for k, (m, n) in enumerate(self.shapes):
            last = k == len(self.shapes) - 1
            # Uniform numbers of that standard deviation.
            u = (2 * draw((m * n + m,), 1, 1, generator=generator).flatten() - 1) * math.sqrt(3)
            u[: m * n] *= 0.0 if last else 1.2 / math.sqrt(n)
            u[m * n :] *= 0.5
            if last:
                u[m * n :] = torch.tensor(offsets)
            parts.append(u)
        return torch.cat([*parts, torch.zeros(self.sizes[0] * self.sizes[-1])])

    def split(self, vector: Tensor) -> tuple[list[Layer], Tensor]:
        """Layers, and the linear part (K, inputs)."""
        layers, at = [], 0
        for m, n in self.shapes:
            layers.append((vector[at : at + m * n].view(m, n), vector[at + m * n : at + m * n + m]))
            at += m * n + m
        return layers, vector[at:].view(self.sizes[-1], self.sizes[0])

    def outputs(self, vector: Tensor, x: Tensor) -> Tensor:
        """(n, K) for inputs (n, inputs)."""
        return self.traced(vector, x).outputs

    def traced(self, vector: Tensor, x: Tensor) -> Traced:
        """The outputs with what derivatives need."""
        layers, skip = self.split(vector)
        seen, slopes, hidden = [x], [], x
        for weight, offset in layers[:-1]:
            z = torch.addmm(offset, hidden, weight.T)
            slopes.append(ROOT.slope(z))
            hidden = ROOT.value(z)
            seen.append(hidden)
        weight, offset = layers[-1]
        return Traced(torch.addmm(offset, hidden, weight.T) + x @ skip.T, seen, slopes)

    def derivatives(self, vector: Tensor, traced: Traced, factors: Tensor, *, last: bool = False) -> Tensor:
        """Rows (n, length) of Σ_k factors[:, k] d outputs[:, k] / d vector; only the places of `linear` if `last`."""
        layers, _ = self.split(vector)
        back, columns = factors, [(factors[:, :, None] * traced.seen[0][:, None, :]).flatten(1)]
        for k in range(len(layers) - 1, -1, -1):
            columns.append(back)
            columns.append((back[:, :, None] * traced.seen[k][:, None, :]).flatten(1))
            if last:
                break
            if k:
                back = (back @ layers[k][0]) * traced.slopes[k - 1]
        return torch.cat(columns[::-1], 1)

    def linear(self) -> Tensor:
        """Which places of the vector the outputs are linear in: last layer and linear part."""
        m, n = self.shapes[-1]
        mask = torch.zeros(self.length, dtype=torch.bool)
        mask[self.length - m * n - m - m * self.sizes[0] :] = True
        return mask

    def folded(self, vector: Tensor, mean: Tensor, spread: Tensor) -> tuple[list[Layer], Tensor]:
        """Layers and linear part for inputs as they are."""
        return folded(*self.split(vector), mean, spread)


class Normal(NamedTuple):
    """Matrix JᵀJ and slope Jᵀr of a mean of squares, float64, and its value."""

    matrix: Tensor
    slope: Tensor
    value: float


class Term(ABC):
    """A mean of squares, of rows that are drawn anew for each step."""

    @abstractmethod
    def redraw(self, vector: Tensor, step: int) -> None:
        """Choose the rows of this step, and hold their weights."""

    @abstractmethod
    def normal(self, vector: Tensor) -> Normal:
        """Its linearisation."""

    @abstractmethod
    def value(self, vector: Tensor) -> float:
        """What it is."""


def minimised(
    terms: Sequence[Term], vector: Tensor, steps: int, advance: Callable[[int], None], *, only: Tensor | None = None
) -> Tensor:
    """`vector` after `steps` damped Gauss–Newton steps on the sum of the terms; only in those places, if given.

    With `only`, the terms' matrices are of these places.
    """
    damping = 1e-2
    for step in range(steps):
        for term in terms:
            term.redraw(vector, step)
        found = [term.normal(vector) for term in terms]
        matrix = torch.stack([each.matrix for each in found]).sum(0)
        slope = torch.stack([each.slope for each in found]).sum(0)
        before = sum(each.value for each in found)
        for _ in range(TRIES):
            move = torch.linalg.solve(matrix + damping * torch.diag(matrix.diagonal() + 1e-8), -slope).to(vector.dtype)
            tried = vector.clone()
            if only is None:
                tried += move
            else:
                tried[only] += move
            if sum(term.value(tried) for term in terms) < before:
                vector, damping = tried, max(damping / 5, LEAST)
                break
            damping *= 6
        advance(1)
    return vector
