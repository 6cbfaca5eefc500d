"""A kernel as machine code: its values, and its gradients when they are first asked for."""

import math
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any

import torch
from torch import Tensor

from torchms.evaluation import blocks, threads
from torchms.evaluation.inputs import Element, Inputs
from torchms.evaluation.run import Run
from torchms.evaluation.signature import Signature
from torchms.machine.code import EACH, MEAN, TOTAL, Code, Column, Result
from torchms.machine.record import Recorder, record

MOST_GRADIENTS = 1024
"""Numbers that all elements share of which machine code gives gradients; of more they are computed eagerly."""


class Compiled:
    """The machine code of a `Signature`. announced: shows what is being compiled, while it is."""

    def __init__(
        self, signature: Signature, inputs: Inputs, name: str, announced: Callable[[str], AbstractContextManager[Any]]
    ) -> None:
        self.signature, self.name, self.announced = signature, name, announced
        self.kernel = signature.kernel
        self.lock = threading.Lock()
        self.backward: dict[tuple[bool, ...], Code] = {}
        self.dtypes: list[torch.dtype] = []
        with announced(name), torch.no_grad():
            program, shapes = record(lambda recorder: self._recorded(Element(recorder, inputs)))
            self.code = Code(program, signature.exact)
        # What is recorded has one row, and one path.
        self.leads = [shape[: -2 if self.kernel.per_path else -1] for shape in shapes]

    def _recorded(self, element: Element) -> tuple[Tensor, ...]:
        found = self.kernel(element.bsdf, *element.directions, element.numbers)
        self.dtypes = [x.dtype for x in found]
        return found

    def values(self, inputs: Inputs) -> tuple[Tensor, ...]:
        """(rows, *lead), or (rows, N, *lead) if the kernel is per path."""
        n, each = inputs.n_rows, self.kernel.per_path
        wholes = self.room(n, inputs.n_paths)
        run = Run(self.code, inputs, inputs.columns(), self.results(wholes, n), self.scale(inputs.n_paths), wholes)
        run.whole()
        if run.call.bad and inputs.look is not None:
            inputs.look()
        return tuple(blocks.surfaced(whole, torch.Size([n]), each) for whole in wholes)

    def room(self, n_rows: int, n_paths: int) -> list[Tensor]:
        """Tensors (*lead, [N], rows) for the values, not filled."""
        size = (n_paths, n_rows) if self.kernel.per_path else (n_rows,)
        return [torch.empty(*lead, *size, dtype=t) for lead, t in zip(self.leads, self.dtypes, strict=True)]

    def results(self, wholes: Sequence[Tensor], n_rows: int) -> list[Result]:
        """Where the values of each element go in this `room`."""
        how = EACH if self.kernel.per_path else MEAN
        return [part for whole in wholes for part in _parts(whole, n_rows, how)]

    def scale(self, n_paths: int) -> float:
        """What a sum over the paths is multiplied by."""
        return 1.0 if self.kernel.per_path else 1 / n_paths

    def gradients(self, inputs: Inputs, grads: Sequence[Tensor], wanted: tuple[bool, ...]) -> list[Tensor | None]:
        """Of each tensor of `inputs` that is wanted, from those of the values."""
        code = self._backward(inputs, wanted)
        n = inputs.n_rows
        columns = inputs.columns()
        for grad, lead in zip(grads, self.leads, strict=True):
            columns += _columns(grad, lead, self.kernel.per_path)
        found: list[Tensor | None] = []
        results: list[Result] = []
        totals: list[tuple[Tensor, int, int]] = []
        for x, entry, want in zip(inputs.tensors, inputs.inputs, wanted, strict=True):
            if not want:
                found.append(None)
                continue
            if entry.role != "shared" and len(x) == n:
                count = math.prod(entry.columns)
                whole = torch.empty(count, n, dtype=x.dtype)
                results += _parts(whole, n, MEAN)
                found.append(whole.T if entry.columns else whole[0])
            else:
                whole = torch.empty_like(x, memory_format=torch.contiguous_format)
                totals.append((whole, len(results), whole.numel()))
                results += [Result(0, 0, 0, TOTAL)] * whole.numel()
                found.append(whole)
        scale = self.scale(inputs.n_paths)
        sums = Run(code, inputs, columns, results, scale, [x for x in found if x is not None]).whole()
        for whole, first, count in totals:
            whole.view(-1).copy_(torch.tensor(sums[first : first + count], dtype=torch.float64) * scale)
        return found

    def _backward(self, inputs: Inputs, wanted: tuple[bool, ...]) -> Code:
        with self.lock:
            if wanted not in self.backward:
                with self.announced(f"backward of {self.name}"), torch.enable_grad():
                    program, _ = record(lambda recorder: self._derivatives(recorder, inputs, wanted))
                    self.backward[wanted] = Code(program, self.signature.exact)
            return self.backward[wanted]

    def _derivatives(self, recorder: Recorder, inputs: Inputs, wanted: tuple[bool, ...]) -> list[Tensor]:
        element = Element(recorder, inputs, wanted)
        values = self._recorded(element)
        grads = []
        for value in values:
            parts = [recorder.column(value.dtype) for _ in range(value.numel())]
            grads.append(torch.stack(parts).reshape(value.shape))
        leaves = [part for parts, want in zip(element.leaves, wanted, strict=True) if want for part in parts]
        pairs = [(value, grad) for value, grad in zip(values, grads, strict=True) if value.requires_grad]
        if not pairs:
            return [torch.zeros_like(leaf) for leaf in leaves]
        found = torch.autograd.grad([v for v, _ in pairs], leaves, [g for _, g in pairs], allow_unused=True)
        return [torch.zeros_like(x) if grad is None else grad for x, grad in zip(leaves, found, strict=True)]

    def serves(self, inputs: Inputs, wanted: tuple[bool, ...]) -> bool:
        """Whether machine code gives these gradients."""
        entries = [(x, entry) for x, entry, want in zip(inputs.tensors, inputs.inputs, wanted, strict=True) if want]
        shared = sum(x.numel() for x, entry in entries if entry.role == "shared")
        return shared <= MOST_GRADIENTS and all(entry.role in ("direction", "map", "shared") for _, entry in entries)


class Differentiated(torch.autograd.Function):
    """Values whose graph has one node: nothing of a kernel is stored between forward and backward but its inputs."""

    @staticmethod
    def forward(ctx: Any, program: Compiled, inputs: Inputs, *tensors: Tensor) -> tuple[Tensor, ...]:
        ctx.program, ctx.inputs = program, inputs.without_tensors()
        ctx.save_for_backward(*tensors)
        return program.values(inputs)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        inputs: Inputs = ctx.inputs.with_tensors(ctx.saved_tensors)
        wanted = ctx.needs_input_grad[2:]
        if torch.is_grad_enabled() or threads.bound_to_this_thread() or not ctx.program.serves(inputs, wanted):
            return None, None, *_eagerly(ctx.program, inputs, grad_outputs, wanted)
        return None, None, *ctx.program.gradients(inputs, grad_outputs, wanted)


def _eagerly(
    program: Compiled, inputs: Inputs, grads: Sequence[Tensor], wanted: tuple[bool, ...]
) -> list[Tensor | None]:
    """The gradients by eager code, themselves with a graph where one is wanted."""
    again = torch.is_grad_enabled()
    with torch.enable_grad():
        if not again:
            inputs = inputs.with_tensors(
                [x.detach().requires_grad_(w) for x, w in zip(inputs.tensors, wanted, strict=True)]
            )
        values = blocks.run(program.kernel, *inputs.eager())
        leaves = [x for x, want in zip(inputs.tensors, wanted, strict=True) if want]
        pairs = [(value, grad) for value, grad in zip(values, grads, strict=True) if value.requires_grad]
        found = iter(
            torch.autograd.grad(
                [v for v, _ in pairs], leaves, [g for _, g in pairs], allow_unused=True, create_graph=again
            )
        )
    return [next(found) if want else None for want in wanted]


def _parts(whole: Tensor, n_rows: int, how: int) -> list[Result]:
    """Where each number of one element goes in (*lead, [N], rows)."""
    size = whole.element_size()
    path = n_rows * size if how == EACH else 0
    step = n_rows * size * (whole.shape[-2] if how == EACH else 1)
    count = whole.numel() * size // step if step else 0
    return [Result(whole.data_ptr() + k * step, size, path, how) for k in range(count)]


def _columns(grad: Tensor, lead: torch.Size, per_path: bool) -> list[Column]:
    """The numbers of one element of a gradient (rows, [N], *lead)."""
    size = grad.element_size()
    row, *tail = (s * size for s in grad.stride())
    path, tail = (tail[0], tail[1:]) if per_path else (0, tail)
    offsets = [0]
    for length, step in zip(lead, tail, strict=True):
        offsets = [o + i * step for o in offsets for i in range(length)]
    return [Column(grad.data_ptr() + o, row, path) for o in offsets]
