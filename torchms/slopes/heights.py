"""Height maps: what one must be, and the slopes of its facets."""

import math
from typing import Any

import numpy as np

Length = float | int
Spacing = Length | tuple[Length, Length]


def checked_heights(heights: np.ndarray, name: str) -> np.ndarray:
    """`heights` if they are a finite real array of at least 4 × 4, or ValueError."""
    if heights.ndim != 2 or min(heights.shape) < 4 or heights.dtype.kind not in "fiub":
        raise ValueError(
            f"{name} must be a real 2-D array of at least 4 x 4 texels; got shape {heights.shape}, dtype "
            f"{heights.dtype}. Pass one channel of the height map."
        )
    bad = ~np.isfinite(heights)
    if bad.any():
        where = np.argwhere(bad)
        first = tuple(int(i) for i in where[0])
        (a, c), (b, d) = where.min(0).tolist(), where.max(0).tolist()
        raise ValueError(
            f"{name} must be finite; got {heights[first]} at index {first} ({int(bad.sum())} of {heights.size} texels, all in "
            f"[{a}:{b + 1}, {c}:{d + 1}]). Crop the holes of the measurement, or fill them: torchms.microsurface.filled(h)."
        )
    return heights


def checked_spacing(spacing: Spacing, name: str) -> tuple[float, float]:
    """`spacing` as two floats if both are finite and positive, or ValueError."""
    pair = (spacing, spacing) if isinstance(spacing, int | float) else spacing
    if len(pair) != 2 or not all(math.isfinite(step) and step > 0 for step in pair):
        raise ValueError(
            f"{name} must be one or two finite lengths above 0; got {pair}. It is the distance between texels."
        )
    return (float(pair[0]), float(pair[1]))


def facet_slopes(heights: Any, spacing: tuple[float, float], periodic: bool) -> np.ndarray:
    """Slopes (n, 2) of the two facets of every cell, split along its (i + 1, j)–(i, j + 1) diagonal.

    periodic: cells also lie between the last row or column and the first.
    """
    h = np.asarray(heights, dtype=np.float64)
    if periodic:
        h = np.pad(h, ((0, 1), (0, 1)), mode="wrap")
    sx, sy = np.diff(h, axis=0) / spacing[0], np.diff(h, axis=1) / spacing[1]
    lower = np.stack([sx[:, :-1], sy[:-1, :]], -1).reshape(-1, 2)
    upper = np.stack([sx[:, 1:], sy[1:, :]], -1).reshape(-1, 2)
    return np.concatenate([lower, upper])
