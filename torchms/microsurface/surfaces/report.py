"""What a surface is like: its slopes against a Gaussian's, its heights."""

import math
from typing import Any

import numpy as np

from torchms.microsurface.surfaces.differences import forward, rms


def report(heights: np.ndarray, spacing: tuple[float | int, float | int], bins: int) -> dict[str, Any]:
    """JSON-serialisable, of heights (n_x, n_y) at this `spacing`.

    slope_covariance is measured. slope_distance: per axis, the total variation distance
    (0 … 1) between the histogram of the facets' slopes, in `bins` bins over ±4 rms, and the Beckmann one of
    the same variance (a Gaussian). heights: histogram over `bins` bins, with its moments.
    """
    sx, sy = (forward(heights, axis) / step for axis, step in enumerate(spacing))
    h = heights - heights.mean()
    spread = rms(h)
    counts, edges = np.histogram(h, bins=bins)
    unit = h / spread if spread > 0 else h
    # The two facets of a cell have slopes (sx_j, sy_i) and (sx_{j+1}, sy_{i+1}).
    covariance = 0.5 * np.mean(sx * sy) + 0.5 * np.mean(np.roll(sx, -1, 1) * np.roll(sy, -1, 0))
    return {
        "size": list(heights.shape),
        "spacing": list(spacing),
        "slope_covariance": float(covariance),
        "slope_distance": [_distance_to_gaussian(s, bins) for s in (sx, sy)],
        "heights": {
            "rms": spread,
            "min": float(h.min()),
            "max": float(h.max()),
            "skewness": float(np.mean(unit**3)),
            "excess_kurtosis": float(np.mean(unit**4) - 3) if spread > 0 else 0.0,
            "edges": edges.tolist(),
            "share": (counts / h.size).tolist(),
        },
    }


def _distance_to_gaussian(slopes: np.ndarray, bins: int) -> float:
    spread = rms(slopes)
    if spread == 0:
        return 1.0
    edges = np.linspace(-4, 4, bins + 1)
    share = np.histogram(slopes / spread, bins=edges)[0] / slopes.size
    cumulative = np.array([0.5 * (1 + math.erf(e / math.sqrt(2))) for e in edges])
    expected = np.diff(cumulative)
    outside = abs((1 - share.sum()) - (1 - expected.sum()))
    return float(0.5 * (np.abs(share - expected).sum() + outside))
