"""Random numbers that are computed where they are used: (seed, path, dimension) → number, nothing is stored.

A number is a hash in 32-bit words; eager mode, Inductor and ONNX Runtime give the same bits. Every row (element of the
batch) has a 64-bit seed of its own; a row's numbers depend on nothing else, so neither blocks, nor shards, nor the order
of rows change them.
"""

from collections.abc import Sequence
from typing import overload

import torch
from torch import Tensor

from torchms.sampling.point_sets import BITS, shared_points

SEQUENCES = ("random", "sobol", "rank1")
WORD = 0xFFFFFFFF


def _signed(c: int) -> int:
    """The multiplier congruent to `c` mod 2^32 of least magnitude: a 32-bit word times it stays inside int64."""
    return c - (1 << 32) if c >> 31 else c


# The 32-bit mixer "lowbias32" (github.com/skeeto/hash-prospector): x ^= x >> 16, x *= A, x ^= x >> 15, x *= B,
# x ^= x >> 16. GOLDEN is 2^32 / the golden ratio, PATH an odd number far from its multiples.
_A, _B = _signed(0x7FEB352D), _signed(0x846CA68B)
_GOLDEN, _PATH = _signed(0x9E3779B9), _signed(0xD1B54A33)
_KEYS = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344)  # digits of pi


# A word is held in int32, whose products wrap around: half the memory and twice the lanes of int64. ONNX shifts no int32
# and promises no wrapping, so in an export words are int64 numbers in [0, 2^32), cut after every operation. Same bits.


def _word(x: Tensor) -> Tensor:
    """The lower 32 bits of an int64."""
    x = x & WORD
    return x if torch.compiler.is_exporting() else x.to(torch.int32)


def _shift(x: Tensor, n: int) -> Tensor:
    """x >> n of an unsigned word."""
    return x >> n if x.dtype == torch.int64 else (x >> n) & (WORD >> n)


def _plus(x: Tensor, c: int | Tensor) -> Tensor:
    """x + c mod 2^32."""
    return (x + c) & WORD if x.dtype == torch.int64 else x + (_signed(c & WORD) if isinstance(c, int) else c)


def _times(x: Tensor, c: int) -> Tensor:
    """x · c mod 2^32, c signed."""
    return (x * c) & WORD if x.dtype == torch.int64 else x * c


def _mix(x: Tensor, inject: Tensor | None = None) -> Tensor:
    """A bijection of 32-bit words; `inject` is added to the state half-way."""
    x = _times(x ^ _shift(x, 16), _A)
    if inject is not None:
        x = x ^ inject
    x = _times(x ^ _shift(x, 15), _B)
    return x ^ _shift(x, 16)


def _state(seeds: Tensor, path: Tensor) -> tuple[Tensor, Tensor]:
    """64 well-mixed bits, as two words, for each 64-bit seed and path: a Feistel network of four rounds a path."""
    x, y = _word(seeds), _word(seeds >> 32)
    step = _times(_word(path), _PATH)
    y = y ^ _mix(_plus(x + step, _KEYS[0]))
    x = x ^ _mix(_plus(y + step, _KEYS[1]))
    y = y ^ _mix(_plus(x, _KEYS[2]))
    x = x ^ _mix(_plus(y, _KEYS[3]))
    return x, y


def _integer(state: tuple[Tensor, Tensor], dimension: int | Tensor) -> Tensor:
    """The 24-bit integer of one dimension; every number depends on all 64 bits of the state."""
    x, y = state
    return _shift(_mix(_plus(x, dimension * _GOLDEN), y), 32 - BITS)


class Stream:
    """Stands wherever `u` does: `bsdf(wi, wo, Stream(7, n_paths=4))`; yields 24-bit numbers in [0, 1).

    seed: an int in [0, 2^31), which gives row r of the (flattened) batch the 64-bit seed `seed · 2^32 + r`; or an int64
    tensor (*batch) with one seed an element, any value. n_paths: N, the independent paths.
    sequence: "random"; or "sobol" or "rank1", where the N paths of a row are a scrambled Sobol set or a rank-1 lattice,
    rotated by the row's own random numbers.
    Raises TypeError or ValueError for a seed or a number of paths outside these ranges.
    """

    def __init__(self, seed: int | Tensor, n_paths: int = 1, sequence: str = "random") -> None:
        if isinstance(seed, Tensor):
            if seed.dtype != torch.int64:
                raise TypeError(
                    f"Stream(seed=...) must be an int or an int64 Tensor (*batch), one an element; got {seed.dtype}."
                )
        elif isinstance(seed, bool) or not isinstance(seed, int):
            raise TypeError(f"Stream(seed=...) must be an int or an int64 Tensor (*batch); got {type(seed).__name__}.")
        elif not 0 <= seed < 2**31:
            raise ValueError(
                f"Stream(seed=...) must lie in [0, 2^31); got {seed}. "
                "For 64-bit seeds give an int64 Tensor, one an element."
            )
        if isinstance(n_paths, bool) or not isinstance(n_paths, int):
            raise TypeError(f"Stream(n_paths=...) must be an int; got {type(n_paths).__name__}.")
        if not 1 <= n_paths < 2**31:
            raise ValueError(f"Stream(n_paths=...) must lie in [1, 2^31); got {n_paths}.")
        if sequence not in SEQUENCES:
            raise ValueError(f"Stream(sequence=...) must be one of {', '.join(SEQUENCES)}; got {sequence!r}.")
        self.seed, self.n_paths, self.sequence = seed, n_paths, sequence

    def __repr__(self) -> str:
        seed = tuple(self.seed.shape) if isinstance(self.seed, Tensor) else self.seed
        return f"Stream({seed}, n_paths={self.n_paths}, sequence={self.sequence!r})"

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the seeds; empty for an int, which serves any batch."""
        return self.seed.shape if isinstance(self.seed, Tensor) else torch.Size(())

    def seeds(self, batch_shape: Sequence[int], device: torch.device | str | None = None) -> Tensor:
        """The 64-bit seed of each element, int64 (*batch): what an ONNX file with a `seed` input takes."""
        if isinstance(self.seed, Tensor):
            return self.seed.to(device).expand(torch.Size(batch_shape))
        rows = torch.arange(torch.Size(batch_shape).numel(), device=device).reshape(torch.Size(batch_shape))
        return rows + (self.seed << 32)

    def uniforms(
        self,
        batch_shape: Sequence[int],
        n_uniforms: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str | None = None,
    ) -> Tensor:
        """The numbers themselves, (*batch, N, D): a call with them gives what a call with the stream gives.

        They are computed on `device`, and are the same on all; None takes that of the seeds, or the default one.
        """
        numbers = self._numbers(self.seeds(batch_shape, device), n_uniforms, dtype, slice(0, self.n_paths))
        # Inductor would compute the integers of a stack of floats as floats.
        compiling = torch.compiler.is_compiling()
        stacked = numbers.stacked() if compiling else torch.stack([numbers[d] for d in range(n_uniforms)])
        return stacked.permute(*range(2, stacked.ndim), 1, 0)

    def block(self, batch_shape: Sequence[int], rows: slice, device: torch.device) -> Tensor:
        """The seeds of `rows` of the flattened batch, (rows,); one entry if they are the same for all."""
        if not isinstance(self.seed, Tensor):
            return torch.arange(rows.start, rows.stop, device=device) + (self.seed << 32)
        seed = self.seed.to(device)
        if seed.numel() == 1:
            return seed.reshape(1)
        return seed.expand(torch.Size(batch_shape)).reshape(-1)[rows]

    def numbers(
        self, seeds: Tensor, n_uniforms: int, dtype: torch.dtype, paths: slice | None = None
    ) -> Sequence[Tensor]:
        """The D numbers, each (paths, *seeds.shape); computed when they are asked for, all together in an export."""
        numbers = self._numbers(seeds, n_uniforms, dtype, slice(0, self.n_paths) if paths is None else paths)
        return numbers.stacked().unbind(0) if torch.compiler.is_exporting() else numbers

    def _numbers(self, seeds: Tensor, n_uniforms: int, dtype: torch.dtype, paths: slice) -> "StreamNumbers":
        index = torch.arange(paths.start, paths.stop, device=seeds.device)
        return StreamNumbers(seeds, index, n_uniforms, dtype, self._points(n_uniforms, paths, seeds.device))

    def _points(self, n_uniforms: int, paths: slice, device: torch.device) -> Tensor | None:
        """The shared points of the paths as 24-bit integers, (D, paths); None for independent ones."""
        if self.sequence == "random":
            return None
        return shared_points(self.sequence, self.n_paths, n_uniforms)[:, paths].to(device)


class StreamNumbers(Sequence[Tensor]):
    """Numbers of a block of rows, by dimension; each is computed when it is first asked for.

    seeds: (*rows). paths: (N,), or of as many axes as `seeds` plus one. points: (D, *paths) of a shared set, or None.
    """

    def __init__(
        self, seeds: Tensor, paths: Tensor, n_uniforms: int, dtype: torch.dtype, points: Tensor | None = None
    ) -> None:
        self.n_uniforms, self.dtype, self.points = n_uniforms, dtype, points
        self.seeds, self.paths = seeds, paths
        self.known: dict[int, Tensor] = {}
        self.mixed: tuple[Tensor, Tensor] | None = None

    @property
    def state(self) -> tuple[Tensor, Tensor]:
        """The mixed words of each row and path."""
        if self.mixed is None:  # not by functools.cached_property, whose lock torch.compile cannot enter
            seeds = self.seeds[None]
            # In a rotated set all paths share the row's random numbers.
            self.mixed = _state(seeds, self._column(self.paths) if self.points is None else torch.zeros_like(seeds))
        return self.mixed

    def _column(self, per_path: Tensor) -> Tensor:
        """`per_path` with an axis for each axis of the rows."""
        return per_path.reshape(per_path.shape + (1,) * (self.seeds.ndim + 1 - per_path.ndim))

    def __len__(self) -> int:
        return self.n_uniforms

    @overload
    def __getitem__(self, d: int) -> Tensor: ...
    @overload
    def __getitem__(self, d: slice) -> tuple[Tensor, ...]: ...
    def __getitem__(self, d: int | slice) -> Tensor | tuple[Tensor, ...]:
        if isinstance(d, slice):
            return tuple(self[i] for i in range(*d.indices(self.n_uniforms)))
        if not 0 <= d < self.n_uniforms:
            raise IndexError(d)
        if d not in self.known:
            point = None if self.points is None else self._column(self.points[d])
            self.known[d] = self._float(_integer(self.state, d), point)
        return self.known[d]

    def stacked(self) -> Tensor:
        """All numbers by the same operations on one tensor (D, paths, *rows): a graph of few nodes."""
        x, y = self.state
        d = torch.arange(self.n_uniforms, dtype=x.dtype, device=x.device).reshape(-1, *(1,) * x.ndim)
        points = None if self.points is None else torch.stack([self._column(point) for point in self.points])
        return self._float(_integer((x[None], y[None]), d), points)

    def _float(self, n: Tensor, point: Tensor | None) -> Tensor:
        if point is not None:
            n = (n + point) & ((1 << BITS) - 1)
        return n.to(self.dtype) * (1 / (1 << BITS))
