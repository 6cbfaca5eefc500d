"""A small network of a few numbers per element, with a linear part beside it."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

Layer = tuple[Tensor, Tensor]
"""Weights (outputs, inputs) and offsets (outputs,)."""


def soft_sign(x: Tensor) -> Tensor:
    """x / (1 + |x|): continuous with its first derivative, and one division."""
    return x / (1 + x.abs())


def folded(layers: Sequence[Layer], skip: Tensor, mean: Tensor, spread: Tensor) -> tuple[list[Layer], Tensor]:
    """Layers and linear part, of inputs with mean 0 and spread 1, for inputs as they are."""
    layers, skip, mean, spread = (
        [(w.double(), b.double()) for w, b in layers],
        skip.double(),
        mean.double(),
        spread.double(),
    )
    weight, offset = layers[0]
    layers[0] = weight / spread, offset - weight @ (mean / spread)
    weight, offset = layers[-1]
    layers[-1] = weight, offset - skip @ (mean / spread)
    return [(w.float(), b.float()) for w, b in layers], (skip / spread).float()


class Network(nn.Module):
    """Hidden layers x → activation(W x + b), an affine last one, and a linear map `skip` of the inputs added to it.

    Inputs that are left out at the end count as 0.
    """

    def __init__(
        self, layers: Sequence[Layer], skip: Tensor, activation: Callable[[Tensor], Tensor] = soft_sign
    ) -> None:
        super().__init__()
        self.depth = len(layers)
        self.activation = activation
        self.hidden = layers[-1][0].shape[1]
        joined = [*layers[:-1], (torch.cat([layers[-1][0], skip], 1), layers[-1][1])]
        for k, (weight, offset) in enumerate(joined):
            # Copies: what is read from a file once serves many networks, one of which may be trained.
            self.register_buffer(f"weight_{k}", weight.clone(), persistent=False)
            self.register_buffer(f"offset_{k}", offset.clone(), persistent=False)

    def forward(self, inputs: Sequence[Tensor]) -> list[Tensor]:
        """The outputs, each of the shape that the inputs broadcast to."""
        values = list(inputs)
        for k in range(self.depth - 1):
            values = [self.activation(x) for x in self._affine(k, values)]
        return self._affine(self.depth - 1, [*values, *inputs])

    def _affine(self, k: int, values: Sequence[Tensor]) -> list[Tensor]:
        """W x + b as one product of matrices."""
        weight, offset = getattr(self, f"weight_{k}"), getattr(self, f"offset_{k}")
        stacked = torch.stack(torch.broadcast_tensors(*values))
        flat = stacked.reshape(len(values), stacked[0].numel())
        dtype = torch.promote_types(weight.dtype, flat.dtype)
        found = torch.addmm(offset[:, None].to(dtype), weight[:, : len(values)].to(dtype), flat.to(dtype))
        return list(found.reshape(len(weight), *stacked.shape[1:]).unbind(0))
