"""The network of a training: one flat vector of numbers, whose inputs have mean 0 and spread 1."""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor

from torchms.approximations.metal_features import FEATURES
from torchms.approximations.metal_lobes import EXPONENT, MOST_FALL, OUTPUTS
from torchms.approximations.network import Layer, soft_sign
from torchms.sampling.uniforms import draw


class Heads:
    """What the outputs (n, 7) of the network mean; the training's counterpart of `MetalLobes.rest`."""

    def __init__(self, outputs: Tensor) -> None:
        self.level = torch.exp(outputs[:, 0].clamp(*EXPONENT))
        a, b = torch.exp(outputs[:, 1].clamp(-9, 9)), torch.exp(outputs[:, 2].clamp(-9, 9))
        last = 1 / (1 + a + b)
        self.shares = torch.stack([a * last, b * last, last], -1)
        self.cosines = 0.5 + 0.5 * soft_sign(outputs[:, 3:6])
        fall = 0.5 * MOST_FALL * (1 + soft_sign(outputs[:, 6]))
        self.mean_order = 4 + fall / (1 - fall)


class Weights:
    """Shapes of the layers within the vector, and the map between it and what a file holds."""

    def __init__(self, widths: Sequence[int], mean: Tensor, spread: Tensor) -> None:
        self.sizes = [FEATURES, *widths, OUTPUTS]
        self.mean, self.spread = mean, spread

    def initial(self, generator: torch.Generator) -> Tensor:
        """A vector to begin with."""
        parts = []
        for k, (n, m) in enumerate(pairwise(self.sizes)):
            last = k == len(self.sizes) - 2
            # Uniform numbers of that standard deviation.
            weight = (2 * draw((m * n + m,), 1, 1, generator=generator).flatten() - 1) * math.sqrt(3)
            weight[: m * n] *= (0.3 if last else 1.2) / math.sqrt(n)
            weight[m * n :] *= 0.0 if last else 0.5
            if last:
                weight[m * n] = -3.0
            parts.append(weight)
        return torch.cat([*parts, torch.zeros(FEATURES)])

    def split(self, vector: Tensor) -> tuple[list[Layer], Tensor]:
        """Layers, and the linear part (FEATURES) of the first output."""
        layers, at = [], 0
        for n, m in pairwise(self.sizes):
            layers.append((vector[at : at + m * n].view(m, n), vector[at + m * n : at + m * n + m]))
            at += m * n + m
        return layers, vector[at:]

    def outputs(self, vector: Tensor, inputs: Tensor) -> Tensor:
        """The outputs (n, 7) for standardised features (n, FEATURES)."""
        layers, skip = self.split(vector)
        x = inputs
        for weight, offset in layers[:-1]:
            x = soft_sign(torch.addmm(offset, x, weight.T))
        weight, offset = layers[-1]
        found = torch.addmm(offset, x, weight.T)
        return torch.cat([found[:, :1] + (inputs @ skip)[:, None], found[:, 1:]], 1)

    def folded(self, vector: Tensor) -> tuple[list[Layer], Tensor]:
        """Layers and linear part (7, FEATURES) for features as they are."""
        layers, skip = self.split(vector.detach().double())
        mean, spread = self.mean.double(), self.spread.double()
        weight, offset = layers[0]
        layers[0] = weight / spread, offset - weight @ (mean / spread)
        weight, offset = layers[-1]
        offset = offset.clone()
        offset[0] -= skip @ (mean / spread)
        layers[-1] = weight, offset
        whole = torch.zeros(OUTPUTS, FEATURES, dtype=torch.float64)
        whole[0] = skip / spread
        return [(w.float(), b.float()) for w, b in layers], whole.float()
