"""Estimates with standard errors, their differences in standard errors, and one significance budget over many of them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

NORMAL_BELOW = 0.03
"""Relative standard error below which the mean of bounded shares is taken as normal."""


class Estimate(NamedTuple):
    """A mean with its standard error, any shape, over `n` independent samples."""

    mean: Tensor
    stderr: Tensor
    n: int


def estimate(samples: Tensor, dim: int = 0) -> Estimate:
    """Mean and standard error of `samples` along `dim`, in float64. Raises ValueError for fewer than two samples."""
    samples = samples.detach().double()
    n = samples.shape[dim]
    if n < 2:
        raise ValueError(
            f"estimate(samples=...) needs at least 2 samples along dim {dim}; got shape {tuple(samples.shape)}."
        )
    return Estimate(samples.mean(dim), samples.std(dim) / math.sqrt(n), n)


def exactly(value: Tensor) -> Estimate:
    """A number that is known without error."""
    return Estimate(value.double(), torch.zeros_like(value, dtype=torch.float64), 1)


def zscore(a: Estimate, b: Estimate, rounding: float | Tensor = 0.0) -> Tensor:
    """(a − b) in standard errors of the difference; `rounding` is an absolute error that is not counted against it."""
    difference = a.mean - b.mean
    excess = difference.sign() * (difference.abs() - rounding).clamp_min(0)
    error = (a.stderr**2 + b.stderr**2).sqrt()
    return torch.where(excess == 0, 0.0, excess / error)


def share_zscore(a: Estimate, b: Estimate, rounding: float | Tensor = 0.0) -> Tensor:
    """`zscore` for means of samples in [0, 1] (shares of an energy), right for rare events too.

    Unless both relative standard errors are less than `NORMAL_BELOW`, a sample's standard error says little: the events that
    matter may not have occurred. Then the two are compared as if they were counts, by the signed root of the likelihood
    ratio: no other distribution on [0, 1] with the same mean has heavier tails. Nothing counted is no special case.
    """
    pooled = (a.n * a.mean + b.n * b.mean) / (a.n + b.n)
    ratio = a.n * _divergence(a.mean, pooled) + b.n * _divergence(b.mean, pooled)
    as_counts = (a.mean - b.mean).sign() * (2 * ratio).clamp_min(0).sqrt()
    normal = (a.stderr < NORMAL_BELOW * a.mean) & (b.stderr < NORMAL_BELOW * b.mean)
    return torch.where(normal, zscore(a, b, rounding), as_counts)


def _divergence(p: Tensor, q: Tensor) -> Tensor:
    """Kullback–Leibler divergence of two Bernoulli distributions."""
    p, q = p.clamp(0, 1), q.clamp(0, 1)
    return torch.special.xlogy(p, p / q).nan_to_num(0) + torch.special.xlogy(1 - p, (1 - p) / (1 - q)).nan_to_num(0)


def p_value(z: Tensor) -> Tensor:
    """Probability of a normal |z| at least as large."""
    return torch.special.erfc(z.double().abs() / math.sqrt(2))


def sidak(level: float, tests: int) -> float:
    """Level of each of `tests` independent tests, such that all of them pass with probability 1 − `level`.

    Raises ValueError unless `level` lies in (0, 1) and `tests` is at least 1.
    """
    if not 0 < level < 1:
        raise ValueError(f"level must lie in (0, 1); got {level}. It is the probability of a false alarm.")
    if tests < 1:
        raise ValueError(f"tests must be at least 1; got {tests}.")
    return -math.expm1(math.log1p(-level) / tests)


def combined(p_values: Tensor | Sequence[float]) -> float:
    """Probability that the smallest of independent p-values is at most as small as it is [Šidák]."""
    p = torch.as_tensor(p_values, dtype=torch.float64).reshape(-1)
    if p.numel() == 0:
        raise ValueError("combined(p_values) needs at least one p-value; got none.")
    least = float(torch.where(p.isnan(), 0.0, p).min())
    return 1.0 if least >= 1 else -math.expm1(p.numel() * math.log1p(-least))
