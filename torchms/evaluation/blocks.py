"""Evaluation in cache-sized blocks: memory is bounded by the block, never by the user's batch.

Eager kernels run fastest on some 2^16 numbers at a time. Of fewer, Python takes longer to start an operation than it takes,
and threads wait for the interpreter; of millions, every intermediate is a fresh allocation. Blocks run side by side, one a
thread.
"""

import functools
import itertools
import math
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.evaluation import threads
from torchms.evaluation.kernel import Kernel
from torchms.evaluation.numbers import Source, Streamed, flat_rows, lifted, split_rows
from torchms.maths.frame import Vec3
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import parameters, weights, with_parameters

BLOCK = 1 << 16
"""Most rows × paths that are evaluated at a time on a CPU, unless a call says otherwise."""
SPLIT = 1 << 15
"""Rows × paths that are not cut further, whatever the number of threads."""
BLOCK_ELSEWHERE = 1 << 22
"""The same on other devices, which are slow to start an operation and fast to do it."""
LARGEST = 1 << 48
"""Elements of a batch; more overflow what torch counts with, before they overflow every memory."""
LANES = 64
"""Vector code and the scalar code at a loop's end differ in last bits: blocks of a multiple of it end as the batch does."""
SHARED = 2048
"""Elements of an operation from which on torch itself opens threads."""


def _components(directions: Sequence[Tensor], batch_ndim: int) -> list[Vec3]:
    """Each direction as components with a path axis of one in front of the batch axes."""
    return [Vec3(*lifted(d, batch_ndim, 1).unsqueeze(0).unbind(-1)) for d in directions]


def batch_shape(module: Parametric, directions: Sequence[Tensor], source: Source) -> torch.Size:
    """The shape to which directions, random numbers and per-pixel parameters broadcast.

    Raises ValueError if they do not, or if that has more elements than can be counted.
    """
    given = {"wi": directions[0].shape[:-1]}
    given |= {"wo": directions[1].shape[:-1]} if len(directions) > 1 else {}
    given |= {"u": source.batch_shape} if source.batch_shape else {}
    shapes = module.parameter_batch_shapes()
    try:
        batch = torch.broadcast_shapes(*given.values(), *shapes)
        if not torch.compiler.is_compiling() and math.prod(batch) > LARGEST:
            raise ValueError(f"the batch {tuple(batch)} has more than 2^48 elements. Evaluate parts of it.")
        return batch
    except RuntimeError:
        listing = ", ".join(f"{name} {tuple(shape)}" for name, shape in given.items())
        raise ValueError(
            f"batch shapes do not broadcast: {listing}; parameters {[tuple(s) for s in shapes if s]}. wi and wo are "
            "(*batch, 3), u is (*batch, N, D), parameters are (*batch)."
        ) from None


def whole(kernel: Kernel, module: Parametric, directions: Sequence[Tensor], source: Source) -> tuple[Tensor, ...]:
    """`kernel` over the whole batch at once, whose axes stay: what is traced has no blocks."""
    batch = batch_shape(module, directions, source)
    if isinstance(source, Streamed):
        source = source.spread(batch, directions[0].device)
    outputs = kernel(module, *_components(directions, len(batch)), source.numbers(len(batch)))
    return tuple(surfaced(out, batch, kernel.per_path) for out in outputs)


def run(
    kernel: Kernel, module: Parametric, directions: Sequence[Tensor], source: Source, block: int | None = None
) -> tuple[Tensor, ...]:
    """`kernel` over blocks of rows and paths: (*batch, *lead), or (*batch, N, *lead) if it is per path.

    block: rows × paths of one; None for what is fastest: up to `BLOCK`, or `BLOCK_ELSEWHERE` off the CPU.
    """
    if torch.compiler.is_compiling():
        return whole(kernel, module, directions, source)
    batch = batch_shape(module, directions, source)
    device = directions[0].device
    n_rows, n_paths = batch.numel(), source.n_paths
    best = _even(n_rows, n_paths, module) if device.type == "cpu" else BLOCK_ELSEWHERE
    rows, paths = _cut(n_rows, n_paths, block or best)
    results = _Results(kernel, rows, paths)
    parts = _Parts(module, batch, directions, source.flattened(batch, device), rows)

    def compute(row: int, some: Sequence[int]) -> None:
        here, components, numbers = parts.of(row)
        for path in some:
            results.add(row, path, kernel(here, *components, numbers.paths(paths[path]).numbers()))

    n = threads.n_threads() if device.type == "cpu" else 1
    if n == 1 or max(rows) * min(n_paths, paths[0].stop) <= SHARED or threads.bound_to_this_thread():
        for row in range(len(rows)):
            compute(row, range(len(paths)))
    elif len(rows) >= n:
        threads.share(len(rows), lambda row: compute(row, range(len(paths))), n, join=False)
    else:
        jobs = list(itertools.product(range(len(rows)), range(len(paths))))
        threads.share(len(jobs), lambda i: compute(jobs[i][0], [jobs[i][1]]), n, join=False)
    return tuple(out.reshape((*batch, *out.shape[1:])) for out in results.found())


def _even(n_rows: int, n_paths: int, module: Parametric) -> int:
    """Size of blocks of which there is an even number, for threads to share; it depends on nothing but the batch."""
    most = min([BLOCK, *(part.most_at_once for part in module.modules() if isinstance(part, Parametric))])
    step = -(-n_rows // (2 * math.ceil(n_rows * n_paths / (2 * most)) or 1))
    step += -step % LANES if step > LANES else 0
    return max(min(SPLIT, most), min(step * n_paths, most))


def _cut(n_rows: int, n_paths: int, size: int) -> tuple[list[int], list[slice]]:
    """Rows of each block, and the parts of the paths, none larger than `size` elements."""
    step = max(1, min(n_rows, size // max(1, n_paths)))
    if LANES < step < n_rows:
        step -= step % LANES
    rows = [min(step, n_rows - first) for first in range(0, n_rows, step)] or [0]
    at_once = max(1, min(n_paths, size))
    return rows, [slice(first, min(first + at_once, n_paths)) for first in range(0, n_paths, at_once)]


class _Parts:
    """Directions, random numbers and parameters of each block of rows."""

    def __init__(
        self, module: Parametric, batch: torch.Size, directions: Sequence[Tensor], source: Source, rows: list[int]
    ) -> None:
        self.directions = [_each(flat_rows(d, batch, 1), rows) for d in directions]
        self.sources = source.rows(rows)
        declared = parameters(module)
        self.maps: dict[str, Sequence[Tensor]] = {}
        single = {}
        for name, (record, value) in declared.items():
            if record.batch(value).numel() == 1:
                single[name] = value.reshape(value.shape[-1:] if record.channels else ())
            else:
                self.maps[name] = flat_rows(value, batch, int(record.channels)).split(rows)
        # What all blocks share and a gradient is wanted of, a tensor of its own for each: their gradients are added up in
        # the order of the blocks, whichever is done first.
        learned = {name: x for name, x in weights(module).items() if x.requires_grad}
        if len(rows) > 1 and torch.is_grad_enabled():
            for name, x in (single | learned).items():
                if x.requires_grad:
                    single.pop(name, None)
                    self.maps[name] = x.expand(len(rows), *x.shape).unbind(0)
        self.module = with_parameters(module, single)

    def of(self, row: int) -> tuple[Any, list[Vec3], Source]:
        """What the kernel is given for block `row`."""
        here = with_parameters(self.module, {name: parts[row] for name, parts in self.maps.items()})
        return here, _components([parts[row] for parts in self.directions], 1), self.sources[row]


def _each(x: Tensor, rows: list[int]) -> Sequence[Tensor]:
    """`x` of each block of rows."""
    if len(x) == 1 and len(rows) > 1 and x.requires_grad:
        return x.expand(len(rows), *x.shape).unbind(0)
    return split_rows(x, rows)


def surfaced(out: Tensor, batch: torch.Size, per_path: bool) -> Tensor:
    """(*lead, [N], *batch) → (*batch, [N], *lead)."""
    nb = len(batch)
    tail = out.ndim - nb
    lead = tail - int(per_path)
    out = out.expand(*out.shape[:tail], *batch)
    order = [*range(tail, out.ndim)] + ([lead] if per_path else []) + [*range(lead)]
    return out.permute(order)


class _Results:
    """Puts the blocks' results together: in place where no gradient is wanted, by concatenation where one is.

    Results are (n_rows, [N], *lead) views of (*lead, [N], n_rows) memory, so that each component is contiguous: what the
    kernels write, and what they read fastest if it is given back to them.
    """

    def __init__(self, kernel: Kernel, rows: list[int], paths: list[slice]) -> None:
        self.per_path, self.rows, self.paths = kernel.per_path, rows, paths
        self.n_paths = paths[-1].stop if paths else 0
        self.first = [0, *itertools.accumulate(rows)]
        self.whole: list[Tensor] = []
        self.pieces: dict[tuple[int, int], tuple[Tensor, ...]] = {}
        self.lock = threading.Lock()

    def add(self, row: int, path: int, outputs: tuple[Tensor, ...]) -> None:
        """What the kernel gave for one block; blocks may come in any order."""
        paths = self.paths[path]
        share = (paths.stop - paths.start) / self.n_paths
        if not self.per_path and share != 1:
            outputs = tuple(out * share for out in outputs)
        if any(out.requires_grad for out in outputs) or not (self.per_path or len(self.paths) == 1):
            self.pieces[row, path] = outputs
        else:
            self._write(row, paths, outputs)

    def _write(self, row: int, paths: slice, outputs: Sequence[Tensor]) -> None:
        with self.lock:
            if not self.whole:
                for out in outputs:
                    lead = (*out.shape[:-2], self.n_paths) if self.per_path else out.shape[:-1]
                    self.whole.append(out.new_empty(*lead, self.first[-1]))
        rows = slice(self.first[row], self.first[row + 1])
        for whole, out in zip(self.whole, outputs, strict=True):
            if self.per_path:
                whole[..., paths, rows] = out
            else:
                whole[..., rows] = out

    def found(self) -> list[Tensor]:
        """Everything: (n_rows, [N], *lead)."""
        if self.pieces:
            parts = [self._joined(row) for row in range(len(self.rows))]
            if any(out.requires_grad for out in parts[0]):
                sized = [
                    [surfaced(out, torch.Size([size]), self.per_path) for out in part]
                    for size, part in zip(self.rows, parts, strict=True)
                ]
                return [torch.cat(column) for column in zip(*sized, strict=True)]
            for row, part in enumerate(parts):
                self._write(row, slice(0, self.n_paths), part)
        return [surfaced(whole, torch.Size([self.first[-1]]), self.per_path) for whole in self.whole]

    def _joined(self, row: int) -> list[Tensor]:
        """The parts of the paths of one block of rows, added up or side by side, always in the same order."""
        columns: Iterator[tuple[Tensor, ...]] = zip(
            *(self.pieces[row, path] for path in range(len(self.paths))), strict=True
        )
        size = self.rows[row]
        if not self.per_path:
            return [functools.reduce(torch.add, column) for column in columns]
        lengths = [paths.stop - paths.start for paths in self.paths]
        return [
            torch.cat([out.expand(*out.shape[:-2], n, size) for out, n in zip(column, lengths, strict=True)], -2)
            for column in columns
        ]
