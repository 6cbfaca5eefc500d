"""Directions against the density they are said to have."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.frame import check_direction
from torchms.storage.write import check_writable, write_whole
from torchms.testing.quadrature import sphere_cells

LEAST = 5.0
"""Fewest expected counts of a cell; smaller ones are pooled."""

LEVEL = 1e-3
"""p-value below which a picture is drawn."""


def chi_square_p_value(counts: Tensor, expected: Tensor) -> float:
    """p-value of Pearson's chi² of `counts` against `expected` ones of the same sum.

    Cells that expect fewer than `LEAST` counts are pooled into one. 0 if something was counted where nothing is expected,
    or less than nothing is. Raises ValueError if the two have another shape or sum, or hold a NaN.
    """
    if counts.shape != expected.shape:
        raise ValueError(
            f"counts and expected must have the same shape; got {tuple(counts.shape)} and {tuple(expected.shape)}."
        )
    counts, expected = counts.double().reshape(-1), expected.double().reshape(-1)
    sums = float(counts.sum()), float(expected.sum())
    if not abs(sums[0] - sums[1]) <= 1e-6 * abs(sums[0]):
        raise ValueError(f"counts and expected must have the same sum; got {sums[0]:g} and {sums[1]:g}.")
    if bool((expected < 0).any()):
        return 0.0
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


class Comparison(NamedTuple):
    """Directions counted in cells, beside the density's integrals over them; `total` is that over the sphere."""

    counts: Tensor
    expected: Tensor
    total: float

    def p_value(self, picture: str | Path | None = None, level: float = LEVEL) -> float:
        """p-value of chi² with the density scaled to 1; drawn to the file `picture` if it is below `level`."""
        expected = self.expected / self.total * self.counts.sum()
        p = chi_square_p_value(self.counts, expected)
        if picture is not None and p < level:
            draw_cells(picture, self.counts, expected, f"chi² of {int(self.counts.sum())} directions: p = {p:.1e}")
        return p


def compared(
    directions: Tensor, density: Callable[[Tensor], Tensor], bins: tuple[int, int] = (32, 32), tolerance: float = 1e-4
) -> Comparison:
    """`directions` (n, 3) against `density` (n, 3) → (n,) [1/sr], whose integral over each cell is adaptive quadrature.

    Raises TypeError or ValueError for directions that are none, or fewer than `2 * LEAST`.
    """
    check_direction(directions, "directions")
    if directions.numel() < 3 * 2 * LEAST:
        raise ValueError(f"directions must be {2 * LEAST:g} at least for a chi² test; got {directions.numel() // 3}.")
    if not bool(((directions.detach().double().norm(dim=-1) - 1).abs() < 1e-2).all()):
        raise ValueError("directions must be unit vectors; there are others, or NaN, among them.")
    expected = sphere_cells(density, bins, tolerance)
    counts = torch.bincount(cell_index(directions, bins).reshape(-1), minlength=bins[0] * bins[1])
    return Comparison(counts.reshape(bins), expected, float(expected.sum()))


def chi_square(
    directions: Tensor,
    density: Callable[[Tensor], Tensor],
    bins: tuple[int, int] = (32, 32),
    tolerance: float = 1e-4,
    *,
    picture: str | Path | None = None,
    level: float = LEVEL,
) -> float:
    """p-value that `directions` (n, 3) were drawn with `density` (n, 3) → (n,) [1/sr].

    The density's integral over each cell is adaptive quadrature; it must be 1 in all, to 1e-3: a density that misses a
    part of the sphere fails, it is not rescaled. Where p is below `level`, counts, expected ones and their difference in
    standard deviations are drawn to the file `picture`, if it is given (which needs matplotlib).
    Raises ValueError if directions are no unit vectors or too few, for `bins` or a `tolerance` that are not positive, and
    if the density does not integrate to 1, OSError if the picture cannot be written.
    """
    if picture is not None:
        check_writable(picture, force=True)
    comparison = compared(directions, density, bins, tolerance)
    if not abs(comparison.total - 1) <= 1e-3:
        raise ValueError(f"chi_square(density=...) must integrate to 1 over the sphere; got {comparison.total:.6f}.")
    return comparison.p_value(picture, level)


def draw_cells(picture: str | Path, counts: Tensor, expected: Tensor, title: str) -> None:
    """Counts and expected counts over φ and cos θ, and their difference in standard deviations."""
    from matplotlib.figure import Figure

    deviation = (counts - expected) / expected.clamp_min(1).sqrt()
    figure = Figure(figsize=(12, 3.4), layout="constrained")
    figure.suptitle(title)
    panels = {"counts": counts, "expected": expected, "difference / √expected": deviation}
    for axes, (name, values) in zip(figure.subplots(1, 3, sharey=True), panels.items(), strict=True):
        largest = float(deviation.abs().max())
        scale = {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest} if values is deviation else {"vmin": 0}
        image = axes.imshow(values.numpy(), origin="lower", extent=(0, 360, -1, 1), aspect="auto", **scale)
        axes.set(title=name, xlabel="φ [°]", ylabel="cos θ")
        figure.colorbar(image, ax=axes)
    content = io.BytesIO()
    figure.savefig(content, format=Path(picture).suffix[1:] or "png", dpi=120)
    write_whole(picture, content.getvalue(), force=True)
