"""(eˣ − 1) / x and ln(1 + x) / x through their removable singularities, with accurate gradients."""

import math

import torch
from torch import Tensor

from torchms.maths.special import polynomial

# Taylor coefficients, highest power first. Up to |x| = ¼ the first left out is below half an ulp of the sum.
EXP_RATIO = {
    torch.float32: tuple(1 / math.factorial(k + 1) for k in range(6, -1, -1)),
    torch.float64: tuple(1 / math.factorial(k + 1) for k in range(11, -1, -1)),
}
# artanh(s) / s in s², s = x / (2 + x).
ATANH_RATIO = {
    torch.float32: tuple(1 / (2 * k + 1) for k in range(4, -1, -1)),
    torch.float64: tuple(1 / (2 * k + 1) for k in range(9, -1, -1)),
}
NEAR = 0.25


def exp_ratio(x: Tensor) -> Tensor:
    """(eˣ − 1) / x; 1 at x = 0. The difference alone would lose its digits, and its gradient more of them, near 0."""
    near = x.abs() < NEAR
    far = torch.where(near, 1.0, x)
    return torch.where(near, polynomial(EXP_RATIO, torch.where(near, x, 0.0)), (torch.exp(far) - 1) / far)


def log_ratio(x: Tensor, u: Tensor) -> Tensor:
    """ln(u) / x for u = 1 + x > 0; 1 at x = 0. Both are given, as one of them has the digits that the other lost."""
    near = x.abs() < NEAR
    # ln(1 + x) = 2 artanh(x / (2 + x)).
    small = torch.where(near, x, 0.0)
    q = 1 / (2 + small)
    s = small * q
    far = torch.where(near, 1.0, x)
    log = torch.log(torch.where(near, 2.0, u))
    return torch.where(near, 2 * q * polynomial(ATANH_RATIO, s * s), log / far)
