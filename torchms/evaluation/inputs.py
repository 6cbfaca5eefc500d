"""The tensors of one call as a program takes them: flattened rows, and numbers that all rows share."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.evaluation.arguments import slack
from torchms.evaluation.kernel import Kernel
from torchms.evaluation.numbers import Given, Source, Streamed, flat_rows
from torchms.evaluation.signature import Input, Signature, structure
from torchms.machine.code import COLUMN, DOUBLES, FLOATS, UNIT, Check, Column
from torchms.machine.record import Recorder
from torchms.maths.frame import Vec3
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import parameters, weights, with_parameters
from torchms.sampling.stream import StreamNumbers


class Inputs:
    """`tensors`, and in `inputs` what each of them is; counters are the columns that no tensor holds.

    look: raises for values that are not to be used, where machine code has found some; None where nobody looks.
    """

    look: Callable[[], None] | None = None

    def __init__(
        self,
        bsdf: Parametric,
        tensors: Sequence[Tensor],
        inputs: Sequence[Input],
        n_rows: int,
        source: Source,
        counters: tuple[Column, ...],
    ) -> None:
        self.bsdf, self.tensors, self.inputs, self.n_rows = bsdf, list(tensors), tuple(inputs), n_rows
        self.source, self.counters = source, counters

    @property
    def n_paths(self) -> int:
        return self.source.n_paths

    @property
    def n_uniforms(self) -> int:
        return self.source.n_uniforms

    @staticmethod
    def of(bsdf: Parametric, batch: torch.Size, directions: Sequence[Tensor], source: Source) -> "Inputs":
        """Those of a call."""
        return Inputs.with_rest(bsdf, batch, directions, source, _rest(bsdf, batch))

    @staticmethod
    def with_rest(
        bsdf: Parametric,
        batch: torch.Size,
        directions: Sequence[Tensor],
        source: Source,
        rest: Sequence[tuple[Input, Tensor]],
    ) -> "Inputs":
        """Those of a call whose BSDF has the inputs `rest`."""
        tensors = [flat_rows(d, batch, 1) for d in directions]
        inputs = [Input("direction", "", d.dtype, (3,)) for d in tensors]

        def add(role: str, x: Tensor, *columns: int) -> None:
            tensors.append(x)
            inputs.append(Input(role, "", x.dtype, columns))

        counters: tuple[Column, ...] = ()
        flat = source.flattened(batch, directions[0].device)
        if isinstance(flat, Given):
            add("number", flat.u, flat.n_uniforms)
        elif isinstance(flat, Streamed):
            counters = _counters(flat, add)
        inputs += [entry for entry, _ in rest]
        tensors += [x for _, x in rest]
        return Inputs(bsdf, tensors, inputs, batch.numel(), flat, counters)

    def with_tensors(self, tensors: Sequence[Tensor]) -> "Inputs":
        """The same inputs with these tensors."""
        return Inputs(self.bsdf, tensors, self.inputs, self.n_rows, self.source, self.counters)

    def without_tensors(self) -> "Inputs":
        """What may be kept without keeping them, or the graphs behind them, alive: all but the tensors."""
        return self.with_tensors(())

    def eager(self) -> tuple[Parametric, list[Tensor], Source]:
        """BSDF, directions and random numbers for eager evaluation."""
        named = zip(self.tensors, self.inputs, strict=True)
        source = self.source
        values, directions = {}, []
        for x, entry in named:
            if entry.role == "direction":
                directions.append(x)
            elif entry.role == "number":
                source = Given(x)
            elif entry.name:
                values[entry.name] = x
        return with_parameters(self.bsdf, values), directions, source

    def signature(self, kernel: Kernel, exact: bool) -> Signature:
        """What tells the program for these inputs."""
        identified: list[Any] = []
        found = structure(self.bsdf, identified, without=("engine",))
        return Signature(kernel, found, self.inputs, self.n_uniforms, torch.get_default_dtype(), exact)

    # For machine code.

    def columns(self) -> list[Column]:
        """Where the numbers of each element are."""
        found = list(self.counters)
        for x, entry in zip(self.tensors, self.inputs, strict=True):
            if entry.role == "shared":
                continue
            size, address = x.element_size(), x.data_ptr()
            steps = [s * size for s in x.stride()]
            row = steps[0] if len(x) == self.n_rows else 0
            if entry.role == "point":  # (D, N)
                found += [Column(address + d * steps[0], 0, steps[1]) for d in range(x.shape[0])]
            elif entry.role == "number":  # (rows, N, D)
                found += [Column(address + d * steps[2], row, steps[1]) for d in range(x.shape[2])]
            elif x.ndim == 2:
                found += [Column(address + c * steps[1], row, 0) for c in range(x.shape[1])]
            else:
                found.append(Column(address, row, 0))
        return found

    def checks(self) -> list[Check]:
        """What checked mode wants of their values."""
        found: list[Check] = []
        column, shared = len(self.counters), 0
        declared = parameters(self.bsdf)
        for x, entry in zip(self.tensors, self.inputs, strict=True):
            count = math.prod(entry.columns)
            if entry.role == "direction":
                found.append(Check(UNIT, column, 3, 1 - slack(x), 1 + slack(x)))
            elif entry.role == "number":
                found += [Check(COLUMN, column + i, 1, 0.0, 1.0) for i in range(count)]
            elif entry.name in declared:
                low, high = declared[entry.name].record.ends(x.dtype)
                if entry.role == "map":
                    found += [Check(COLUMN, column + i, 1, low, high) for i in range(count)]
                else:
                    found.append(Check(FLOATS if x.dtype == torch.float32 else DOUBLES, shared, count, low, high))
            shared += entry.role == "shared"
            column += 0 if entry.role == "shared" else count
        return found

    def shared(self) -> list[Tensor]:
        """The tensors that all elements share, one number after the other."""
        shared = (x for x, entry in zip(self.tensors, self.inputs, strict=True) if entry.role == "shared")
        return [x if x.is_contiguous() else x.detach().contiguous() for x in shared]

    @property
    def rest(self) -> list[tuple[Input, Tensor]]:
        """The parameters of the BSDF and its other tensors."""
        return [(entry, x) for entry, x in zip(self.inputs, self.tensors, strict=True) if entry.name]


def _rest(bsdf: Parametric, batch: torch.Size) -> list[tuple[Input, Tensor]]:
    """The parameters of a BSDF and its other tensors."""
    found = []
    for name, (record, value) in parameters(bsdf).items():
        tail = value.shape[-1:] if record.channels else torch.Size(())
        if record.batch(value).numel() == 1:
            x = value if value.shape == tail else value.reshape(tail)
            found.append((Input("shared", name, value.dtype, tuple(tail)), x))
        else:
            found.append((Input("map", name, value.dtype, tuple(tail)), flat_rows(value, batch, len(tail))))
    for name, value in weights(bsdf).items():
        found.append((Input("shared", name, value.dtype, tuple(value.shape)), value))
    return found


def _counters(flat: Streamed, add: Callable[..., None]) -> tuple[Column, ...]:
    """The columns of seeds and paths that count; tensors of seeds and points are added."""
    seeds = flat.seeds
    paths = Column(0, 0, 1, flat.taken.start)
    points = flat.stream._points(flat.n_uniforms, flat.taken, flat.device or torch.device("cpu"))
    if points is not None:
        add("point", points, len(points))
    if isinstance(seeds, Tensor):
        add("seed", seeds)
        return (paths,)
    assert isinstance(seeds, range) and isinstance(flat.stream.seed, int)
    return (paths, Column(0, 1, 0, (flat.stream.seed << 32) + seeds.start))


class Element:
    """One element while a kernel is recorded: its inputs in the order of the columns of `Inputs`."""

    def __init__(self, recorder: Recorder, inputs: Inputs, wanted: Sequence[bool] = ()) -> None:
        self.leaves: list[list[Tensor]] = []
        counters = [recorder.column(torch.int64) for _ in inputs.counters]
        self.directions: list[Vec3] = []
        self.values: dict[str, Tensor] = {}
        numbers: list[Tensor] = []
        seed = counters[1] if len(counters) > 1 else None
        points = None
        for i, (x, entry) in enumerate(zip(inputs.tensors, inputs.inputs, strict=True)):
            if entry.role == "shared":
                parts = [recorder.shared(x)]
            else:
                count = entry.columns[0] if entry.columns else 1
                parts = [recorder.column(entry.dtype) for _ in range(count)]
            if wanted and wanted[i]:
                parts = [part.requires_grad_() for part in parts]
            self.leaves.append(parts)
            if entry.role == "direction":
                self.directions.append(Vec3(*(part[None] for part in parts)))
            elif entry.role == "number":
                numbers = [part[None] for part in parts]
            elif entry.role == "point":
                points = torch.stack(parts)[:, None]
            elif entry.role == "seed":
                seed = parts[0]
            else:
                self.values[entry.name] = torch.stack(parts, -1) if entry.role == "map" and entry.columns else parts[0]
        self.numbers: Sequence[Tensor] = tuple(numbers)
        if seed is not None:
            assert isinstance(inputs.source, Streamed)
            self.numbers = StreamNumbers(seed, counters[0][None], inputs.n_uniforms, inputs.source.dtype, points)
        self.bsdf = with_parameters(inputs.bsdf, self.values)
