"""Directions against the density they are said to have."""

from collections.abc import Callable

import torch
from torch import Tensor

from torchms.testing.quadrature import sphere_cells

LEAST = 5.0
"""Fewest expected counts of a cell; smaller ones are pooled."""


def chi_square_p_value(counts: Tensor, expected: Tensor) -> float:
    """p-value of Pearson's chi² of `counts` against `expected` ones of the same sum.

    Cells that expect fewer than `LEAST` counts are pooled into one.
    """
    counts, expected = counts.double().reshape(-1), expected.double().reshape(-1)
    small = expected < LEAST
    if bool(small.any()):
        counts = torch.cat([counts[~small], counts[small].sum()[None]])
        expected = torch.cat([expected[~small], expected[small].sum()[None]])
    if expected[-1] <= 0:
        if counts[-1] > 0:
            return 0.0
        counts, expected = counts[:-1], expected[:-1]
    freedom = expected.numel() - 1
    if freedom < 1:
        return 1.0
    statistic = ((counts - expected) ** 2 / expected).sum()
    return float(torch.special.gammaincc(torch.tensor(freedom / 2, dtype=torch.float64), statistic / 2))


def cell_index(w: Tensor, bins: tuple[int, int]) -> Tensor:
    """Index of the cell of each direction (..., 3): cos θ over equal bins of [−1, 1], major; φ over those of [0, 2π)."""
    n_cos, n_phi = bins
    row = ((w[..., 2].double() + 1) * (n_cos / 2)).long().clamp(0, n_cos - 1)
    turn = torch.atan2(w[..., 1].double(), w[..., 0].double()) / (2 * torch.pi)
    return row * n_phi + ((turn % 1.0) * n_phi).long().clamp(0, n_phi - 1)


def chi_square(
    directions: Tensor, density: Callable[[Tensor], Tensor], bins: tuple[int, int] = (32, 32), tolerance: float = 1e-4
) -> float:
    """p-value that `directions` (n, 3) were drawn with `density` (..., 3) → (...) [1/sr].

    The density's integral over each cell is adaptive quadrature; it must be 1 in all, to 1e-3: a density that misses a
    part of the sphere fails, it is not rescaled. Raises ValueError if it is not.
    """
    expected = sphere_cells(density, bins, tolerance)
    total = float(expected.sum())
    if abs(total - 1) > 1e-3:
        raise ValueError(f"chi_square(density=...) must integrate to 1 over the sphere; got {total:.6f}.")
    counts = torch.bincount(cell_index(directions, bins).reshape(-1), minlength=bins[0] * bins[1])
    return chi_square_p_value(counts, expected.reshape(-1) / total * counts.sum())
