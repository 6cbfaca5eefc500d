"""Where the random numbers of a call come from: nowhere, a tensor that was given, or a stream."""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.sampling.stream import Stream


class Source(ABC):
    """Random numbers of every row of a batch: D numbers for each of N paths."""

    n_paths: int
    n_uniforms: int
    given: Tensor | Stream | None = None
    """What a public method was given."""
    batch_shape: torch.Size
    """What the source itself broadcasts to a batch."""

    @abstractmethod
    def flattened(self, batch: torch.Size, device: torch.device) -> "Source":
        """The same with the axes of the batch as one."""

    @abstractmethod
    def rows(self, sizes: Sequence[int]) -> "list[Source]":
        """A flattened source in parts of so many rows each."""

    @abstractmethod
    def paths(self, paths: slice) -> "Source":
        """These of the paths only."""

    @abstractmethod
    def numbers(self, ndim: int = 1) -> Sequence[Tensor]:
        """The D numbers, each (N, *rows), where rows have `ndim` axes."""


class Without(Source):
    """For kernels that draw nothing."""

    n_paths = 1
    n_uniforms = 0
    batch_shape = torch.Size(())

    def flattened(self, batch: torch.Size, device: torch.device) -> "Without":
        return self

    def rows(self, sizes: Sequence[int]) -> list[Source]:
        return [self] * len(sizes)

    def paths(self, paths: slice) -> "Without":
        return self

    def numbers(self, ndim: int = 1) -> tuple[Tensor, ...]:
        return ()


class Given(Source):
    """A tensor (*batch, N, D)."""

    def __init__(self, u: Tensor) -> None:
        self.u = self.given = u
        self.n_paths, self.n_uniforms = u.shape[-2:]
        self.batch_shape = u.shape[:-2]

    def flattened(self, batch: torch.Size, device: torch.device) -> "Given":
        flat = Given(flat_rows(self.u, batch, 2))
        flat.given = self.given
        return flat

    def rows(self, sizes: Sequence[int]) -> list[Source]:
        return [Given(u) for u in split_rows(self.u, sizes)]

    def paths(self, paths: slice) -> "Given":
        return Given(self.u[..., paths, :])

    def numbers(self, ndim: int = 1) -> tuple[Tensor, ...]:
        u = lifted(self.u, ndim, 2)
        return u.permute(-1, -2, *range(ndim)).unbind(0)


class Streamed(Source):
    """The first D numbers of a stream.

    seeds: those of the rows, where they are known: (rows,), one that serves all of them (1,), or a range of rows that are
    counted, whose seeds are made when they are asked for.
    """

    def __init__(
        self,
        stream: Stream,
        n_uniforms: int,
        dtype: torch.dtype,
        seeds: Tensor | range | None = None,
        paths: slice | None = None,
        device: torch.device | None = None,
    ) -> None:
        self.stream, self.n_uniforms, self.dtype, self.given = stream, n_uniforms, dtype, stream
        self.seeds, self.device = seeds, device
        self.taken = slice(0, stream.n_paths) if paths is None else paths
        self.n_paths = self.taken.stop - self.taken.start
        self.batch_shape = seeds.shape if isinstance(seeds, Tensor) else stream.batch_shape

    def _with(self, seeds: Tensor | range | None, paths: slice, device: torch.device | None) -> "Streamed":
        return Streamed(self.stream, self.n_uniforms, self.dtype, seeds, paths, device)

    def flattened(self, batch: torch.Size, device: torch.device) -> "Streamed":
        seeds = self.stream.seed if self.seeds is None else self.seeds
        seeds = flat_rows(seeds.to(device), batch, 0) if isinstance(seeds, Tensor) else range(batch.numel())
        return self._with(seeds, self.taken, device)

    def spread(self, batch: torch.Size, device: torch.device) -> "Streamed":
        """With a seed for every element of the batch, whose axes stay."""
        return self._with(self.stream.seeds(batch, device), self.taken, device)

    def rows(self, sizes: Sequence[int]) -> list[Source]:
        seeds = self.seeds
        assert seeds is not None
        if isinstance(seeds, Tensor):
            return [self._with(part, self.taken, self.device) for part in split_rows(seeds, sizes)]
        ends = itertools.accumulate(sizes)
        return [self._with(seeds[end - n : end], self.taken, self.device) for end, n in zip(ends, sizes, strict=True)]

    def paths(self, paths: slice) -> "Streamed":
        first = self.taken.start
        return self._with(self.seeds, slice(first + paths.start, first + paths.stop), self.device)

    def numbers(self, ndim: int = 1) -> Sequence[Tensor]:
        seeds = self.seeds
        assert seeds is not None and self.device is not None
        if isinstance(seeds, range):
            seeds = self.stream.block(torch.Size((seeds.stop,)), slice(seeds.start, seeds.stop), self.device)
        return self.stream.numbers(seeds, self.n_uniforms, self.dtype, self.taken)


def source(u: Tensor | Stream | None, n_uniforms: int, dtype: torch.dtype) -> Source:
    """What a public method was given, as a source of `n_uniforms` numbers a path."""
    if u is None:
        return Without()
    return Streamed(u, n_uniforms, dtype) if isinstance(u, Stream) else Given(u)


def lifted(tensor: Tensor, ndim: int, trailing: int) -> Tensor:
    """`tensor` with ones in front, so that it has `ndim` axes before its last `trailing` ones."""
    missing = ndim - (tensor.ndim - trailing)
    return tensor.reshape((1,) * missing + tuple(tensor.shape)) if missing else tensor


def flat_rows(tensor: Tensor, batch: torch.Size, trailing: int) -> Tensor:
    """`tensor` with its batch axes flattened to one; a tensor that is the same for all rows keeps one row."""
    tail = tensor.shape[tensor.ndim - trailing :]
    head = tensor.shape[: tensor.ndim - trailing]
    if head.numel() == 1 and batch.numel() != 1:
        return tensor.reshape(1, *tail)
    if len(batch) == 1 and head == batch:
        return tensor
    return tensor.expand((*batch, *tail)).reshape(batch.numel(), *tail)


def split_rows(tensor: Tensor, sizes: Sequence[int]) -> Sequence[Tensor]:
    """`tensor` in parts of so many rows; one row that serves all of them in every part."""
    if len(tensor) == 1 and sum(sizes) != 1:
        return [tensor] * len(sizes)
    return tensor.split(list(sizes))
