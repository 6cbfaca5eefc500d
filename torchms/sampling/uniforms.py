"""The only place that draws random numbers."""

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor
from torch.quasirandom import SobolEngine

SEQUENCES = ("random", "sobol")


def draw(
    batch_shape: Sequence[int],
    n_paths: int,
    n_uniforms: int,
    *,
    generator: torch.Generator | None = None,
    sequence: str = "random",
    dtype: torch.dtype = torch.float32,
    device: torch.device | str | None = None,
) -> Tensor:
    """Uniform numbers in [0, 1), `(*batch_shape, n_paths, n_uniforms)`.

    Each of the `n_uniforms` numbers is contiguous in memory: the result is a permuted view. "sobol" gives every row the
    same scrambled Sobol points, rotated by a random shift of its own, so that rows are independent of each other.
    The result is on `device`; a `generator` draws on its own, so that its numbers are the same for all devices.
    Raises ValueError for an unknown `sequence`, or if a size or n_paths is too small; TypeError if one is no integer.
    """
    batch = _sizes(batch_shape)
    if isinstance(n_paths, bool) or not isinstance(n_paths, int):
        raise TypeError(f"n_paths must be an int; got {n_paths!r}.")
    if n_paths < 1:
        raise ValueError(f"n_paths must be at least 1; got {n_paths}.")
    if sequence not in SEQUENCES:
        raise ValueError(f"sequence must be one of {', '.join(SEQUENCES)}; got {sequence!r}.")
    drawn_on = device if generator is None else generator.device
    if sequence == "random":
        u = torch.rand((n_uniforms, n_paths, *batch), generator=generator, dtype=dtype, device=drawn_on)
    else:
        # The seed is read by the host, so it is drawn there.
        seed = int(torch.randint(2**31 - 1, (), generator=generator, device="cpu" if generator is None else drawn_on))
        points = SobolEngine(n_uniforms, scramble=True, seed=seed).draw(n_paths, dtype=torch.float64).to(drawn_on)
        points = points.T.contiguous().reshape(n_uniforms, n_paths, *(1,) * len(batch))
        shift = torch.rand((n_uniforms, 1, *batch), generator=generator, dtype=torch.float64, device=drawn_on)
        # Rounding to a shorter dtype may reach 1, which is outside of [0, 1).
        u = ((points + shift) % 1.0).to(dtype).clamp_max(1 - torch.finfo(dtype).eps / 2)
    return u.to(device).permute(*range(2, 2 + len(batch)), 1, 0)


def _sizes(batch_shape: Sequence[int]) -> tuple[int, ...]:
    if isinstance(batch_shape, str) or not isinstance(batch_shape, Iterable):
        raise TypeError(f"batch_shape must be a sequence of sizes, such as wi.shape[:-1] or (n,); got {batch_shape!r}.")
    batch = tuple(int(size) for size in batch_shape)
    if min(batch, default=0) < 0:
        raise ValueError(f"batch_shape must hold sizes of at least 0; got {batch}.")
    return batch


def integers(low: int, high: int, shape: Sequence[int], generator: torch.Generator | None = None) -> Tensor:
    """Uniform int64 numbers in [low, high) of that shape."""
    return torch.randint(low, high, tuple(shape), generator=generator)


def permutation(count: int, generator: torch.Generator | None = None) -> Tensor:
    """The int64 numbers below `count` in a drawn order."""
    return torch.randperm(count, generator=generator)


def generator_for(seed: int) -> torch.Generator:
    """A CPU generator seeded with `seed`."""
    return torch.Generator().manual_seed(seed)
