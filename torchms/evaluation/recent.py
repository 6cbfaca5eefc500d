"""What the last call of a kernel found out, for a next one that is like it: small calls cost what they compute.

Nothing is looked at anew that can only change together with one of the objects that are compared here.
"""

from operator import is_
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils import parametrize

from torchms.evaluation.inputs import Inputs
from torchms.evaluation.kernel import Kernel
from torchms.evaluation.numbers import Streamed
from torchms.evaluation.plan import Plan
from torchms.parameters.declared import Parametric
from torchms.sampling.stream import Stream


class Snapshot:
    """The parts of a module as they are now."""

    def __init__(self, module: nn.Module) -> None:
        self.known: list[tuple[dict[str, Any], list[Any]]] = []
        self.tensors: list[tuple[Tensor, torch.Size, torch.dtype]] = []
        # A value that is computed from another tensor is a new one every time.
        self.comparable = not any(parametrize.is_parametrized(part) for part in module.modules())
        for part in module.modules():
            for known in (vars(part), part._parameters, part._buffers, part._modules):
                self.known.append((known, list(known.values())))
                self.tensors += [(x, x.shape, x.dtype) for x in known.values() if isinstance(x, Tensor)]

    def holds(self) -> bool:
        """Whether they are the same objects, of the same shapes, still."""
        for known, values in self.known:
            if len(known) != len(values) or (values and not all(map(is_, known.values(), values))):
                return False
        return all(x.shape == shape and x.dtype is dtype for x, shape, dtype in self.tensors)


class Recent:
    """The last call of a kernel: what was given, and what was made of the BSDF's tensors."""

    def __init__(
        self,
        kernel: Kernel,
        bsdf: Parametric,
        given: tuple[Tensor, ...],
        inputs: Inputs,
        batch: torch.Size,
        program: Any,
    ) -> None:
        self.bsdf, self.snapshot, self.batch, self.program = bsdf, Snapshot(bsdf), batch, program
        self.given = [(x.shape, x.dtype) for x in given]
        self.rest, self.n_uniforms = inputs.rest, inputs.source.n_uniforms
        self.dtype = inputs.source.dtype if isinstance(inputs.source, Streamed) else torch.get_default_dtype()
        self.numbers = _numbers(inputs.source.given)
        self.state = _state()
        self.plan = Plan.of(program, inputs, given, batch)

    def fits(self, bsdf: nn.Module, given: tuple[Tensor, ...], u: Tensor | Stream | None) -> bool:
        """Whether a call is like it."""
        if bsdf is not self.bsdf or self.state != _state() or self.numbers != _numbers(u):
            return False
        for x, (shape, dtype) in zip(given, self.given, strict=True):
            if not isinstance(x, Tensor) or x.shape != shape or x.dtype is not dtype or not _plain(x):
                return False
        return (not isinstance(u, Tensor) or _plain(u)) and self.snapshot.holds()


def _plain(x: Tensor) -> bool:
    return x.is_cpu and x.layout is torch.strided and type(x) in (Tensor, nn.Parameter)


def _numbers(u: Tensor | Stream | None) -> Any:
    if isinstance(u, Stream):
        return u.n_paths, u.sequence, u.batch_shape if isinstance(u.seed, Tensor) else None
    return None if u is None else (u.shape, u.dtype)


def _state() -> tuple[bool, torch.dtype]:
    return torch.is_grad_enabled(), torch.get_default_dtype()
