"""Evaluation in cache-sized blocks: memory is bounded by the block, never by the user's batch.

Eager kernels run fastest on 4 k – 16 k numbers at a time; over millions of rows in one go they are an order of
magnitude slower, because every intermediate is a fresh allocation.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.maths.frame import Vec3
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import parameters, with_parameters
from torchms.sampling.stream import Stream

BLOCK = 8192
"""Rows × paths that are evaluated at a time, unless a call says otherwise."""
LARGEST = 1 << 48
"""Elements of a batch; more overflow what torch counts with, before they overflow every memory."""
LANES = 64
"""Vector code and the scalar code at a loop's end differ in last bits: blocks of a multiple of it end as the batch does."""

Kernel = Callable[..., tuple[Tensor, ...]]


def _lifted(tensor: Tensor, ndim: int, trailing: int) -> Tensor:
    """`tensor` with ones in front, so that it has `ndim` axes before its last `trailing` ones."""
    missing = ndim - (tensor.ndim - trailing)
    return tensor.reshape((1,) * missing + tuple(tensor.shape))


def _rows(tensor: Tensor, batch: torch.Size, trailing: int) -> Tensor:
    """`tensor` with its batch axes flattened to one; a tensor that is the same for all rows keeps one row."""
    tail = tensor.shape[tensor.ndim - trailing :]
    head = tensor.shape[: tensor.ndim - trailing]
    if head.numel() == 1 and batch.numel() != 1:
        return tensor.reshape(1, *tail)
    return tensor.expand(*batch, *tail).reshape(batch.numel(), *tail)


def _components(directions: Sequence[Tensor], batch_ndim: int) -> list[Vec3]:
    """Each direction as components with a path axis of one in front of the batch axes."""
    return [Vec3(*_lifted(d, batch_ndim, 1).unsqueeze(0).unbind(-1)) for d in directions]


def _numbers(u: Tensor | None, batch_ndim: int) -> tuple[Tensor, ...]:
    """The D numbers of `u`, each (N, *batch)."""
    if u is None:
        return ()
    u = _lifted(u, batch_ndim, 2)
    return u.permute(-1, -2, *range(batch_ndim)).unbind(0)


def batch_shape(module: Parametric, directions: Sequence[Tensor], u: Tensor | Stream | None) -> torch.Size:
    """The shape to which directions, random numbers and per-pixel parameters broadcast.

    Raises ValueError if they do not, or if that has more elements than can be counted.
    """
    shapes = [d.shape[:-1] for d in directions]
    if u is not None:
        shapes.append(u.batch_shape if isinstance(u, Stream) else u.shape[:-2])
    shapes += module.parameter_batch_shapes()
    try:
        batch = torch.broadcast_shapes(*shapes)
        if not torch.compiler.is_compiling() and math.prod(batch) > LARGEST:
            raise ValueError(f"the batch {tuple(batch)} has more than 2^48 elements. Evaluate parts of it.")
        return batch
    except RuntimeError:
        names = ["wi", "wo"][: len(directions)] + (["u"] if u is not None else [])
        listing = ", ".join(f"{name} {tuple(shape)}" for name, shape in zip(names, shapes, strict=False))
        parameters = [tuple(s) for s in shapes[len(names) :] if s]
        raise ValueError(
            f"batch shapes do not broadcast: {listing}; parameters {parameters}. wi and wo are (*batch, 3), "
            "u is (*batch, N, D), parameters are (*batch)."
        ) from None


def run(
    kernel: Kernel,
    module: Any,
    directions: Sequence[Tensor],
    u: Tensor | Stream | None,
    *,
    per_path: bool = False,
    block: int | None = None,
) -> tuple[Tensor, ...]:
    """`kernel(module, *directions, numbers)` over blocks of rows and paths.

    The kernel sees directions as `Vec3` of (1, *rows) and numbers of (N, *rows), and returns tensors (*lead, *rows),
    mean over the paths, or (*lead, N, *rows) if `per_path`. The results are (*batch, *lead) and (*batch, N, *lead).
    block: rows × paths of one; None for `BLOCK`, or what the engine was compiled for.
    """
    batch = batch_shape(module, directions, u)
    if torch.compiler.is_compiling():
        nb = len(batch)
        if isinstance(u, Stream):
            numbers = u.numbers(u.seeds(batch, directions[0].device), module.n_uniforms, module.dtype)
        else:
            numbers = _numbers(u, nb)
        outputs = kernel(module, *_components(directions, nb), numbers)
        return tuple(_surfaced(out, batch, per_path) for out in outputs)

    n_rows = batch.numel()
    n_paths = 1 if u is None else u.n_paths if isinstance(u, Stream) else u.shape[-2]
    flat_directions = [_rows(d, batch, 1) for d in directions]
    flat_u = _rows(u, batch, 2) if isinstance(u, Tensor) else None
    declared = parameters(module)
    flattened = {name: _flat_parameter(value, batch, record.channels) for name, (record, value) in declared.items()}
    mapped = {name: p for name, p in flattened.items() if p.ndim > declared[name].record.channels}
    flat = with_parameters(module, flattened)

    engine = module.engine if n_rows else None
    size = (block or BLOCK) if engine is None else engine.block(module)
    identity = None if engine is None else engine.identify(module)
    row_step = max(1, min(n_rows, size // max(1, n_paths)))
    if LANES < row_step < n_rows:
        row_step -= row_step % LANES
    path_step = max(1, min(n_paths, size))
    blocks = _Collector(n_rows, n_paths, per_path)
    for a in range(0, max(n_rows, 1), row_step):
        rows = slice(a, min(a + row_step, n_rows))
        here = with_parameters(flat, {name: p[rows] for name, p in mapped.items()})
        some = _components([d if len(d) == 1 != n_rows else d[rows] for d in flat_directions], 1)
        seeds = u.block(batch, rows, directions[0].device) if isinstance(u, Stream) else None
        for b in range(0, max(n_paths, 1), path_step):
            paths = slice(b, min(b + path_step, n_paths))
            if flat_u is not None:
                numbers = _numbers((flat_u if len(flat_u) == 1 != n_rows else flat_u[rows])[:, paths], 1)
            elif isinstance(u, Stream) and seeds is not None:
                numbers = u.numbers(seeds, module.n_uniforms, module.dtype, paths)
            else:
                numbers = ()
            if engine is None:
                outputs = kernel(here, *some, numbers)
            else:
                shape = (paths.stop - paths.start, rows.stop - rows.start)
                outputs = engine(kernel, here, some, numbers, shape, per_path, identity)
            blocks.add(outputs, rows, paths)
    return tuple(out.reshape((*batch, *out.shape[1:])) for out in blocks.results())


def _flat_parameter(value: Tensor, batch: torch.Size, channels: bool) -> Tensor:
    shape = value.shape[:-1] if channels else value.shape
    if shape.numel() == 1:
        return value.reshape(value.shape[-1:] if channels else ())
    return _rows(value, batch, 1 if channels else 0)


def _surfaced(out: Tensor, batch: torch.Size, per_path: bool) -> Tensor:
    """(*lead, [N], *batch) → (*batch, [N], *lead)."""
    nb = len(batch)
    tail = out.ndim - nb
    lead = tail - int(per_path)
    out = out.expand(*out.shape[:tail], *batch)
    order = [*range(tail, out.ndim)] + ([lead] if per_path else []) + [*range(lead)]
    return out.permute(order)


class _Collector:
    """Puts the blocks' results together: in place where no gradient is wanted, by concatenation where one is.

    Results are (n_rows, [N], *lead) views of (*lead, [N], n_rows) memory, so that each component is contiguous: what the
    kernels write, and what they read fastest if it is given back to them.
    """

    def __init__(self, n_rows: int, n_paths: int, per_path: bool) -> None:
        self.n_rows, self.n_paths, self.per_path = n_rows, n_paths, per_path
        self.whole: list[Tensor] = []
        self.pieces: list[list[Tensor]] | None = None
        self.row: list[list[Tensor]] = []

    def add(self, outputs: tuple[Tensor, ...], rows: slice, paths: slice) -> None:
        if not self.per_path:
            share = (paths.stop - paths.start) / self.n_paths
            outputs = tuple(out if share == 1 else out * share for out in outputs)
        if any(out.requires_grad for out in outputs) or self.pieces is not None:
            size = torch.Size([rows.stop - rows.start])
            self._append(tuple(_surfaced(out, size, self.per_path) for out in outputs), paths)
            return
        if not self.whole:
            for out in outputs:
                lead = (*out.shape[:-2], self.n_paths) if self.per_path else out.shape[:-1]
                self.whole.append(out.new_empty(*lead, self.n_rows))
        for whole, out in zip(self.whole, outputs, strict=True):
            if self.per_path:
                whole[..., paths, rows] = out
            elif paths.start == 0:
                whole[..., rows] = out
            else:
                whole[..., rows] += out

    def _append(self, outputs: tuple[Tensor, ...], paths: slice) -> None:
        if self.pieces is None:
            self.pieces = [[] for _ in outputs]
        if paths.start == 0:
            self.row = [[] for _ in outputs]
        for column, out in zip(self.row, outputs, strict=True):
            column.append(out)
        if paths.stop == self.n_paths:
            for piece, column in zip(self.pieces, self.row, strict=True):
                piece.append(torch.cat(column, 1) if self.per_path else sum(column[1:], column[0]))

    def results(self) -> list[Tensor]:
        if self.pieces is not None:
            return [torch.cat(piece) for piece in self.pieces]
        return [_surfaced(whole, torch.Size([self.n_rows]), self.per_path) for whole in self.whole]
