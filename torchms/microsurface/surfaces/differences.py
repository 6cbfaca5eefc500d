"""Heights over a periodic grid: their differences, and the plane through them."""

import numpy as np


def forward(h: np.ndarray, axis: int) -> np.ndarray:
    """Difference to the next texel along `axis`; the last one's next is the first."""
    return np.roll(h, -1, axis) - h


def rms(x: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def plane(h: np.ndarray) -> np.ndarray:
    """Least-squares plane through `h`; on a full grid the two slopes decouple."""
    x, y = (np.arange(n) - (n - 1) / 2 for n in h.shape)
    return (x @ h.sum(1) / (h.shape[1] * (x @ x))) * x[:, None] + (h.sum(0) @ y / (h.shape[0] * (y @ y))) * y
