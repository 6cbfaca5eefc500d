"""Cubic splines over uniform nodes: a function of one number that costs a few operations a row, whatever it is made of."""

import torch
from torch import Tensor


def spline(values: Tensor) -> Tensor:
    """Coefficients (n + 2, …) of the cubic B-spline that approximates `values` (n, …) at n ≥ 4 uniform nodes, to fourth order.

    It passes the values by sixth differences over 36 only, so that no system is solved; beyond the ends stands the cubic
    through the last four.
    """

    def beyond(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
        return 4 * a - 6 * b + 4 * c - d

    first = beyond(values[0], values[1], values[2], values[3])
    last = beyond(values[-1], values[-2], values[-3], values[-4])
    before = beyond(first, values[0], values[1], values[2])
    after = beyond(last, values[-1], values[-2], values[-3])
    padded = torch.cat([before[None], first[None], values, last[None], after[None]])
    return (8 * padded[1:-1] - padded[:-2] - padded[2:]) / 6


def cell(t: Tensor, n: int) -> tuple[Tensor, tuple[Tensor, ...]]:
    """The cell of t in [0, n − 1] among n nodes, and the weights of the four coefficients from there on."""
    index = torch.floor(t.detach()).clamp(0, n - 2)
    f = t - index
    g = 1 - f
    f2 = f * f
    lowest, highest = g * g * g / 6, f2 * f / 6
    lower = (0.5 * f - 1) * f2 + 2 / 3
    return index.to(torch.int64), (lowest, lower, 1 - lowest - lower - highest, highest)


def interpolated(coefficients: Tensor, t: Tensor) -> Tensor:
    """The spline with these `coefficients` (n + 2,) at t, any shape, in units of the nodes' distance."""
    index, weights = cell(t, len(coefficients) - 2)
    first, *others = (coefficients[index + i] * weight for i, weight in enumerate(weights))
    return sum(others, first)
