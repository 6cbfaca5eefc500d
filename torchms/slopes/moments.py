"""Slopes in bins: what share of them each holds, and their moments in it, so that coarse bins lose little."""

from typing import Any, NamedTuple

import numpy as np

BINS = 96
"""Along each axis, for slopes that are given one by one."""


class Moments(NamedTuple):
    """Of n bins: the share of all slopes, their means (n, 2), and means of x², x y and y² (n, 3)."""

    share: np.ndarray
    first: np.ndarray
    second: np.ndarray
    number: float
    """How many independent slopes they are worth at most."""

    @property
    def mean(self) -> np.ndarray:
        return self.share @ self.first

    @property
    def covariance(self) -> np.ndarray:
        """(2, 2)."""
        xx, xy, yy = self.share @ self.second
        return np.array([[xx, xy], [xy, yy]]) - np.outer(self.mean, self.mean)


def of_slopes(given: Any, given_weights: Any = None, name: str = "slopes") -> Moments:
    """Of slopes (n, 2) with weights (n) or without.

    Bins are uniform in arsinh(slope / r), r half of the median magnitude along the axis: as wide as the slope is large in
    the tails.
    """
    slopes = _finite(given, f"{name}(slopes=...)")
    if slopes.ndim != 2 or slopes.shape[1] != 2 or len(slopes) < 2:
        raise ValueError(f"{name}(slopes=...) must be (n, 2), dz/dx and dz/dy of n >= 2 facets; got {slopes.shape}.")
    weights = None if given_weights is None else _counts(given_weights, (len(slopes),), f"{name}(weights=...)")
    index = np.zeros(len(slopes), dtype=np.int64)
    for s in slopes.T:
        r = 0.5 * np.median(np.abs(s)) or np.abs(s).max() or 1.0
        t = np.arcsinh(s / r)
        low, high = t.min(), t.max()
        place = (t - low) * (BINS / (high - low) if high > low else 0.0)
        index = index * BINS + np.minimum(place.astype(np.int64), BINS - 1)
    x, y = slopes.T
    total = np.bincount(index, weights, BINS * BINS)
    full = total > 0
    scale = 1.0 if weights is None else weights
    sums = [np.bincount(index, scale * v, BINS * BINS)[full] / total[full] for v in (x, y, x * x, x * y, y * y)]
    count = len(slopes) if weights is None else float(weights.sum() ** 2 / (weights**2).sum())
    return Moments(total[full] / total.sum(), np.stack(sums[:2], 1), np.stack(sums[2:], 1), count)


def of_histogram(given: Any, edges: tuple[Any, Any], name: str = "histogram") -> Moments:
    """Of a histogram (n_x, n_y) of slopes, with its edges (n_x + 1) and (n_y + 1), as `numpy.histogram2d` gives it."""
    axes = []
    for axis, some in zip("xy", edges, strict=True):
        e = _finite(some, f"{name}(edges_{axis}=...)")
        if e.ndim != 1 or len(e) < 3 or not (np.diff(e) > 0).all():
            raise ValueError(f"{name}(edges_{axis}=...) must increase, and be at least 3; got shape {e.shape}.")
        axes.append(e)
    counts = _counts(given, (len(axes[0]) - 1, len(axes[1]) - 1), f"{name}(counts=...)")
    full = counts > 0
    density = counts / np.outer(*(np.diff(e) for e in axes))
    means, squares = [], []
    for axis, e in enumerate(axes):
        centre, width = (x.reshape((-1, 1) if axis == 0 else (1, -1)) for x in ((e[1:] + e[:-1]) / 2, np.diff(e)))
        # A density that is linear in a bin has its mean w² ρ' / (12 ρ) off the centre, w / 6 at most. (In uniform bins the
        # variance is that of the centres less w² / 12 then, which is Sheppard's correction.)
        lean = np.gradient(density, centre.ravel(), axis=axis) / np.where(full, density, 1.0)
        off = np.clip(width * width / 12 * lean, -width / 6, width / 6)
        means.append((centre + off)[full])
        squares.append((centre * centre + 2 * centre * off + width * width / 12)[full])
    second = np.stack([squares[0], means[0] * means[1], squares[1]], -1)
    return Moments(counts[full] / counts.sum(), np.stack(means, -1), second, float(counts.sum()))


def _counts(given: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    """Counts or weights of this shape, none negative, not all 0; ValueError otherwise."""
    counts = _finite(given, name)
    if counts.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, one number a bin or slope; got {counts.shape}.")
    if counts.min() < 0 or not counts.sum() > 0:
        raise ValueError(f"{name} must be at least 0, and not all 0; the least is {counts.min():g}.")
    return counts


def _finite(given: Any, name: str) -> np.ndarray:
    """As float64; ValueError unless they are real and finite."""
    array = np.asarray(given)
    if array.dtype.kind not in "fiub" or not array.size:
        raise ValueError(f"{name} must hold real numbers; got shape {array.shape}, dtype {array.dtype}.")
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(
            f"{name} must be finite; got {array[first]} at index {first} ({int(bad.sum())} of {array.size}). "
            "Leave out what was not measured."
        )
    return array.astype(np.float64)
