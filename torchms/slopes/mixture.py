"""Mixtures of Gaussians that follow a distribution of slopes, by expectation and maximisation over bins."""

import math
from typing import Any, NamedTuple

import numpy as np

from torchms.slopes.moments import Moments

LEAST_WIDTH = 1 / 32
"""Standard deviation of the narrowest component, over that of all slopes: what is finer is the grid of a measurement."""
WORTH = 3e-4
"""Mean log-likelihood that twice the components must gain to be kept."""
STEPS = 400
STILL = 1e-7
"""Gain of the mean log-likelihood at which steps end."""
MOST = 256
"""Components that a mixture may have."""
LEAST_VARIANCE, MOST_VARIANCE = 0.5e-6, 450.0
"""Of slopes along any direction: α in [1e-3, 30]."""
MOST_OF_A_TAIL = 1e6
"""Variance of a component, which may stand for a few facets that are all but upright."""
GOLDEN = math.pi * (3 - math.sqrt(5))


class Mixture(NamedTuple):
    """Weights (K), means (K, 2) and covariances (K, 2, 2) of Gaussian components; the mean of all is 0."""

    weights: np.ndarray
    means: np.ndarray
    covariances: np.ndarray


def checked(weights: Any, means: Any, covariances: Any, name: str) -> Mixture:
    """The mixture of these numbers, its weights summing to 1; ValueError with what is wrong with them."""
    w, m, c = (np.asarray(x, dtype=np.float64) for x in (weights, means, covariances))
    if w.ndim != 1 or not 1 <= len(w) <= MOST or m.shape != (len(w), 2) or c.shape != (len(w), 2, 2):
        raise ValueError(
            f"{name}(weights, means, covariances) must be (K,), (K, 2) and (K, 2, 2) with 1 to {MOST} components; got "
            f"{w.shape}, {m.shape} and {c.shape}."
        )
    if not all(np.isfinite(x).all() for x in (w, m, c)):
        raise ValueError(f"{name}: weights, means and covariances must be finite.")
    if w.min() < 0 or not w.sum() > 0:
        raise ValueError(f"{name}(weights=...) must be at least 0, and not all 0; the least is {w.min():g}.")
    if np.abs(c - c.swapaxes(1, 2)).max() > 1e-6 * np.abs(c).max():
        raise ValueError(f"{name}(covariances=...) must be symmetric.")
    variances = np.linalg.eigvalsh(c)
    if variances.min() < LEAST_VARIANCE or variances.max() > MOST_OF_A_TAIL:
        raise ValueError(
            f"{name}(covariances=...) must have variances in [{LEAST_VARIANCE:g}, {MOST_OF_A_TAIL:g}] along every direction; "
            f"got {variances.min():g} to {variances.max():g}. A mirror or a groove is a limit: widen it."
        )
    w = w / w.sum()
    spread = math.sqrt(float(w @ ((m**2).sum(1) + np.trace(c, axis1=1, axis2=2))))
    off = float(np.hypot(*(w @ m)))
    if off > 1e-5 * spread:
        raise ValueError(
            f"{name}(means=...) must sum to 0 with their weights, as the slopes of a level surface do; the sum is of length "
            f"{off:g}. Subtract it from each."
        )
    return Mixture(w, m - w @ m, c)


def mixture(moments: Moments, most: int, name: str = "mixture") -> Mixture:
    """The mixture of at most `most` components that follows `moments`, about their mean.

    Its mean and covariance are theirs (narrow components aside). Components are doubled as long as that gains
    `WORTH` and more than chance would. Raises ValueError for `most` or slopes out of range.
    """
    if not isinstance(most, int) or not 1 <= most <= MOST:
        raise ValueError(f"{name}(components=...) must be an integer in [1, {MOST}]; got {most!r}.")
    variances = np.linalg.eigvalsh(moments.covariance)
    if variances.min() < LEAST_VARIANCE or variances.max() > MOST_VARIANCE:
        raise ValueError(
            f"{name}: the slopes must have variances in [{LEAST_VARIANCE:g}, {MOST_VARIANCE:g}] along every direction, alpha in"
            f" [1e-3, 30]; got {variances.min():g} to {variances.max():g}. A mirror or a groove is a limit; far steeper slopes "
            "are mostly heights and spacing in different units."
        )
    mean = moments.mean
    # About the mean, in units in which the covariance is 1.
    root = np.linalg.cholesky(moments.covariance)
    inverse = np.linalg.inv(root)
    first = (moments.first - mean) @ inverse.T
    xx, xy, yy = moments.second.T
    square = np.stack([xx, xy, xy, yy], -1).reshape(-1, 2, 2)
    cross = moments.first[:, :, None] * mean
    square = square - cross - cross.swapaxes(1, 2) + np.outer(mean, mean)
    square = inverse @ square @ inverse.T
    features = np.stack([np.ones(len(first)), *first.T, square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]], 1)
    best, reached = None, -np.inf
    count = 1
    while count <= most:
        found, likelihood = _fitted(moments.share, features, count)
        # Six numbers a component: by chance they gain half as many over the number of slopes, and a few times that.
        chance = 3 * (count - count // 2) * math.log(max(moments.number, 2.0)) / moments.number
        if best is not None and likelihood < reached + max(WORTH, chance):
            break
        best, reached = found, likelihood
        count *= 2
    assert best is not None
    weights, means, covariances = best
    kept = weights > 1e-6
    weights = weights[kept] / weights[kept].sum()
    means = means[kept] - weights @ means[kept]
    return Mixture(weights, means @ root.T, root @ covariances[kept] @ root.T)


def _start(share: np.ndarray, features: np.ndarray, count: int) -> Mixture:
    """Half of the components are concentric, from the width of the innermost slopes to that of the outermost, the others lie
    around on a spiral."""
    if count == 1:
        return Mixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None])
    r = np.hypot(features[:, 1], features[:, 2])
    order = np.argsort(r)
    below = np.cumsum(share[order])

    def radius(quantile: float) -> float:
        return float(np.interp(quantile, below, r[order]))

    concentric = (count + 1) // 2
    widths = np.geomspace(radius(0.1), max(radius(1 - 1e-5), 2 * radius(0.1)), concentric)
    around = np.arange(count - concentric)
    lengths = np.array([radius((j + 0.5) / len(around)) for j in around])
    means = np.zeros((count, 2))
    means[concentric:] = np.stack([lengths * np.cos(GOLDEN * around), lengths * np.sin(GOLDEN * around)], 1)
    variances = np.maximum(np.concatenate([widths**2, np.full(len(around), 0.25)]), LEAST_WIDTH**2)
    weights = np.full(count, 1 / count)
    weights[:concentric] = concentric / count / widths / (1 / widths).sum()
    return Mixture(weights, means, variances[:, None, None] * np.eye(2))


def _fitted(share: np.ndarray, features: np.ndarray, count: int) -> tuple[Mixture, float]:
    """The mixture of `count` components, and its mean log-likelihood; features (n, 6): 1, x, y, x², x y, y²."""
    found = _start(share, features, count)
    reached = -np.inf
    for _ in range(STEPS):
        logs = features @ _coefficients(found)
        top = logs.max(1)
        parts = np.exp(logs - top[:, None])
        total = parts.sum(1)
        likelihood = float(share @ (top + np.log(total)))
        if abs(likelihood - reached) < STILL:
            break
        reached = likelihood
        sums = (parts * (share / total)[:, None]).T @ features
        found = _wide_enough(sums)
    return found, reached


def _coefficients(m: Mixture) -> np.ndarray:
    """(6, K): of the logarithms of weighted densities, which are linear in the features."""
    P = np.linalg.inv(m.covariances)
    b = np.einsum("kab,kb->ka", P, m.means)
    c = (
        np.log(m.weights)
        - 0.5 * np.einsum("ka,ka->k", b, m.means)
        + 0.5 * np.log(np.linalg.det(P))
        - math.log(2 * math.pi)
    )
    return np.stack([c, b[:, 0], b[:, 1], -0.5 * P[:, 0, 0], -P[:, 0, 1], -0.5 * P[:, 1, 1]])


def _wide_enough(sums: np.ndarray) -> Mixture:
    """The components of these sums of features (K, 6), none narrower than `LEAST_WIDTH`."""
    weights = sums[:, 0] + 1e-300
    moments = sums[:, 1:] / weights[:, None]
    means = moments[:, :2]
    square = moments[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(square - means[:, :, None] * means[:, None])
    values = np.maximum(values, LEAST_WIDTH**2)
    return Mixture(weights, means, vectors @ (values[:, :, None] * vectors.swapaxes(1, 2)))
