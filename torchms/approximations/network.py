"""A small network of a few numbers per element, with a linear part beside it."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn
from torch._subclasses import FakeTensor

Layer = tuple[Tensor, Tensor]
"""Weights (outputs, inputs) and offsets (outputs,)."""


def soft_sign(x: Tensor) -> Tensor:
    """x / (1 + |x|): continuous with its first derivative, and one division."""
    return x / (1 + x.abs())


class Literals:
    """Weights and offsets of all layers as Python numbers, which a compiler makes instructions of; known by identity."""

    def __init__(self, layers: Sequence[Layer]) -> None:
        self.layers = [(weight.tolist(), offset.tolist()) for weight, offset in layers]


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
            self.register_buffer(f"weight_{k}", weight, persistent=False)
            self.register_buffer(f"offset_{k}", offset, persistent=False)
        self.literals = Literals(joined)

    def forward(self, inputs: Sequence[Tensor]) -> list[Tensor]:
        """The outputs, each of the shape that the inputs broadcast to."""
        affine = self._unrolled if _is_traced(inputs[0]) else self._product
        values = list(inputs)
        for k in range(self.depth - 1):
            values = [self.activation(x) for x in affine(k, values)]
        return affine(self.depth - 1, [*values, *inputs])

    def _product(self, k: int, values: Sequence[Tensor]) -> list[Tensor]:
        """W x + b as one product of matrices: fastest operation by operation, and one node of a file."""
        weight, offset = getattr(self, f"weight_{k}"), getattr(self, f"offset_{k}")
        stacked = torch.stack(torch.broadcast_tensors(*values))
        flat = stacked.reshape(len(values), -1)
        dtype = torch.promote_types(weight.dtype, flat.dtype)
        found = torch.addmm(offset[:, None].to(dtype), weight[:, : len(values)].to(dtype), flat.to(dtype))
        return list(found.reshape(-1, *stacked.shape[1:]).unbind(0))

    def _unrolled(self, k: int, values: Sequence[Tensor]) -> list[Tensor]:
        """W x + b number by number: one loop without intermediates in memory, once Inductor has it."""
        found = []
        for row, offset in zip(*self.literals.layers[k], strict=True):
            total: Tensor | float = offset
            for factor, value in zip(row, values, strict=False):
                if factor != 0.0:
                    total = value * factor + total
            assert isinstance(total, Tensor)
            found.append(total)
        return found


def _is_traced(x: Tensor) -> bool:
    """Whether Inductor will make a loop of what is done with `x`, not an exporter a file."""
    if torch.compiler.is_exporting():
        return False
    return torch.compiler.is_compiling() or isinstance(x, FakeTensor)
