"""Least squares of few parameters within bounds: Levenberg–Marquardt with the Jacobian from central differences.

Source: Moré 1978, "The Levenberg-Marquardt Algorithm: Implementation and Theory", for the scaled damping.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

STEP = 1e-4
"""Of a difference, relative to the range of the parameter."""
DAMPING = (1e-3, 1e12)
"""At first, and where it gives up."""
ENOUGH = 1e-10
"""Relative decrease of the sum of squares below which a step is the last."""


class Fit(NamedTuple):
    """values and errors (P,), one standard error each; NaN where a value is at its bound. covariance (P, P) of the others.

    From the Gauss–Newton approximation: s² (Jᵀ J)⁻¹, s² = residuals² / (n − P). rms: of the residuals. steps: taken.
    """

    values: Tensor
    errors: Tensor
    covariance: Tensor
    rms: float
    steps: int


def jacobian(residuals: Callable[[Tensor], Tensor], x: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """(n, P) at x by differences that stay within the bounds."""
    columns = []
    for k in range(len(x)):
        h = STEP * float(high[k] - low[k])
        above, below = x.clone(), x.clone()
        above[k], below[k] = torch.minimum(x[k] + h, high[k]), torch.maximum(x[k] - h, low[k])
        columns.append((residuals(above) - residuals(below)) / (above[k] - below[k]))
    return torch.stack(columns, -1)


@torch.no_grad()
def least_squares(
    residuals: Callable[[Tensor], Tensor],
    start: Tensor,
    low: Tensor,
    high: Tensor,
    *,
    steps: int = 60,
    advance: Callable[[int], None] = lambda steps: None,
) -> Fit:
    """The x (P,) in [low, high] that makes the sum of the squares of `residuals(x)` (n,) least, from `start`, float64.

    advance: is told of every step.
    """
    x, damping = start.clamp(low, high), DAMPING[0]
    r = residuals(x)
    J, done = jacobian(residuals, x, low, high), 0
    while done < steps:
        done += 1
        advance(1)
        gradient, moves = J.T @ r, _moves(x, J.T @ r, low, high)
        A = (J.T @ J)[moves][:, moves]
        before, trial, found = float(r @ r), x, r
        while damping < DAMPING[1]:
            scaled = A + damping * torch.diag(A.diagonal().clamp_min(1e-300))
            trial = x.clone()
            trial[moves] = x[moves] - torch.linalg.lstsq(scaled, gradient[moves, None]).solution[:, 0]
            trial = trial.clamp(low, high)
            found = residuals(trial)
            if float(found @ found) < before:
                break
            damping *= 10
        now = float(found @ found)
        if not now < before * (1 - ENOUGH):
            break
        x, r, damping = trial, found, damping / 10
        J = jacobian(residuals, x, low, high)
    return _judged(x, r, J, low, high, done)


def _moves(x: Tensor, gradient: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Which parameters are not held by a bound that the descent pushes them against."""
    return ~(((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0)))


def _judged(x: Tensor, r: Tensor, J: Tensor, low: Tensor, high: Tensor, steps: int) -> Fit:
    free = (x > low) & (x < high)
    covariance = torch.full((len(x), len(x)), torch.nan, dtype=x.dtype)
    inner = J[:, free]
    s2 = (r @ r) / max(len(r) - int(free.sum()), 1)
    found = s2 * torch.linalg.pinv(inner.T @ inner, hermitian=True)
    where = free.nonzero()[:, 0]
    covariance[where[:, None], where] = found
    return Fit(x, covariance.diagonal().sqrt(), covariance, float(r.square().mean().sqrt()), steps)
