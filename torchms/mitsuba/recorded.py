"""The kernels of a BSDF as functions of Dr.Jit's numbers: value, density, and a sample with both."""

import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.bsdfs import kernels
from torchms.bsdfs.base import BSDF
from torchms.machine.record import Recorder, record
from torchms.machine.simplify import simplified
from torchms.maths.frame import Vec3
from torchms.mitsuba.edge import swept
from torchms.mitsuba.replay import Replay, Value
from torchms.parameters.exchange import parameters, with_parameters
from torchms.paths.refractive import Refractive

Direction = tuple[Value, Value, Value]


def _value(bsdf: BSDF, directions: Sequence[Vec3], numbers: Sequence[Tensor]) -> list[Tensor]:
    if torch.is_grad_enabled() and isinstance(bsdf.vertex, Refractive):
        first, *rest = kernels.ORDERS(bsdf, *directions, numbers)[0]
        return [sum(rest, first * swept(bsdf.vertex, *directions))]
    (value,) = kernels.FORWARD(bsdf, *directions, numbers)
    return [value]


def _pdf(bsdf: BSDF, directions: Sequence[Vec3], numbers: Sequence[Tensor]) -> list[Tensor]:
    (pdf,) = kernels.PDF(bsdf, *directions, numbers)
    return [pdf]


def _sample(bsdf: BSDF, directions: Sequence[Vec3], numbers: Sequence[Tensor]) -> list[Tensor]:
    (wi,) = directions
    return list(kernels.SAMPLE(bsdf, wi, bsdf.proposal.from_three(wi, *numbers)))


class Kernel(NamedTuple):
    """What is recorded: a function of a BSDF, of so many directions, and of so many numbers; None for those of a value."""

    function: Callable[[BSDF, Sequence[Vec3], Sequence[Tensor]], list[Tensor]]
    n_directions: int
    n_numbers: int | None


VALUE = Kernel(_value, 2, None)
PDF = Kernel(_pdf, 2, 0)
SAMPLE = Kernel(_sample, 1, 3)


class Recorded:
    """A BSDF whose declared parameters are given at every call; its weights and tables are constants.

    parameters: name → how many numbers it is. n_numbers: random numbers that a value takes; 0 if it is no estimate.
    """

    def __init__(self, bsdf: BSDF) -> None:
        self.bsdf = bsdf
        self.n_channels = bsdf.n_channels
        found = parameters(bsdf)
        self.parameters = {name: value.shape[-1] if record.channels else 0 for name, (record, value) in found.items()}
        self.dtypes = {name: value.dtype for name, (_, value) in found.items()}
        self.n_numbers = 0 if bsdf.scattering.is_deterministic(bsdf.vertex) else bsdf.n_uniforms
        self._replays: dict[tuple[Kernel, bool], Replay] = {}
        self._lock = threading.Lock()

    def value(
        self, wi: Direction, wo: Direction, given: Sequence[Value], numbers: Sequence[Value], differentiable: bool
    ) -> list[Value]:
        """f · |cos θ_o| [1/sr], a number a channel; `given` are the numbers of all parameters, one after the other."""
        return self._replay(VALUE, differentiable)([*wi, *wo, *numbers, *given])

    def pdf(self, wi: Sequence[Value], wo: Sequence[Value], given: Sequence[Value]) -> Value:
        """Density of `sample` at `wo` [1/sr]."""
        return self._replay(PDF, False)([*wi, *wo, *given])[0]

    def sample(self, wi: Sequence[Value], numbers: Sequence[Value], given: Sequence[Value]) -> tuple[Direction, Value]:
        """A direction from three random numbers, which is what a renderer gives, and its density [1/sr]."""
        x, y, z, pdf = self._replay(SAMPLE, False)([*wi, *numbers, *given])
        return (x, y, z), pdf

    def _replay(self, kernel: Kernel, differentiable: bool) -> Replay:
        """`kernel`; differentiable: with the guards of gradients, and with what sampled directions are held for."""
        key = (kernel, differentiable)
        with self._lock:
            if key not in self._replays:
                with torch.set_grad_enabled(differentiable):
                    program, _ = record(lambda recorder: self._run(kernel, recorder, differentiable), differentiable)
                if not differentiable:
                    program = simplified(program, fast=False)
                self._replays[key] = Replay(program, branches=not (differentiable or self.n_numbers))
            return self._replays[key]

    def _run(self, kernel: Kernel, recorder: Recorder, differentiable: bool) -> list[Tensor]:
        """One element, as in `torchms.evaluation.inputs.Element`: components (1 path, 1 row)."""

        def columns(count: int, dtype: torch.dtype = torch.float32) -> list[Tensor]:
            return [recorder.column(dtype).requires_grad_(differentiable) for _ in range(count)]

        directions = [Vec3(*(x[None] for x in columns(3))) for _ in range(kernel.n_directions)]
        n_numbers = self.n_numbers if kernel.n_numbers is None else kernel.n_numbers
        numbers = [recorder.column(torch.float32)[None] for _ in range(n_numbers)]
        values = {}
        for name, channels in self.parameters.items():
            parts = columns(max(channels, 1), self.dtypes[name])
            values[name] = torch.stack(parts, -1) if channels else parts[0]
        return kernel.function(with_parameters(self.bsdf, values), directions, numbers)
