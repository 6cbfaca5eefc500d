"""What the facets reflect that light meets on its way, for any Fresnel term: F at four cosines and a few means.

Over cosines c every reflectance of a metal or of glass is within 0.5 % a sum of four functions of c,

    F(c) = F(1) + A (1 − c)⁵ + B c (1 − c)³ + C c (1 − c)⁸,

with A, B and C from F at 1, 1/2, 0.15 and 0; Schlick's curve is one of them. So the mean reflectance of the facets of order k
follows from the means of the three functions there, whatever F is. Two facets of one path are not independent: v is the
covariance of (1 − c)⁵ at both over the square of its mean, and the mean of a product F F' is F̄² + v (F̄ − F(1))².
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.network import soft_sign
from torchms.fresnel.base import Fresnel
from torchms.maths.constants import constants

NODES = (1.0, 0.5, 0.15, 0.0)
"""Cosines at which F is looked at."""
MEANS = 4
"""Numbers of an order: three means, and v."""
MOST = (1.0, 0.25 * 0.75**3, (1 / 9) * (8 / 9) ** 8)
"""Largest value of each function."""
LEAST_SPREAD = (-1.0, -1 / 3, -1 / 6)
"""Smallest v of the orders 2, 3 and ≥ 4: no product is negative."""
SPAN = 4.0
"""From the smallest to the largest v."""


def shapes(c: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The three functions of cosines c in [0, 1]."""
    x = 1 - c
    x3 = x * x * x
    x5 = x3 * x * x
    return x5, c * x3, c * x3 * x5


def _inverse() -> list[list[float]]:
    """A, B and C from F − F(1) at the other nodes."""
    rows = torch.stack(shapes(torch.tensor(NODES[1:], dtype=torch.float64)), -1)
    return np.linalg.inv(rows.numpy()).tolist()


INVERSE = _inverse()


class Met(NamedTuple):
    """Facets of one order: means of the three functions [1], and v [1]."""

    first: Tensor
    second: Tensor
    third: Tensor
    spread: Tensor


def met(outputs: Sequence[Tensor], order: int) -> Met:
    """From MEANS outputs of a network; order: 0, 1 and 2 for 2, 3 and ≥ 4 bounces."""
    a, b, c, d = (0.5 + 0.5 * soft_sign(x) for x in outputs)
    # The first is small where facets are met squarely: its fifth root is learned.
    x = 1 - a
    return Met(x * x * x * x * x, MOST[1] * b, MOST[2] * c, LEAST_SPREAD[order] + SPAN * d)


def mean_reflectances(fresnel: Fresnel, orders: Sequence[Met]) -> tuple[Tensor, list[Tensor]]:
    """Kernel: F(1), and F̄ of each order, in [0, 1]; channels first, (C, N, …)."""
    like = orders[0].first
    at = fresnel.reflectance(constants(NODES, like).reshape(-1, *(1,) * (like.ndim - 1)))
    facing, *others = (at[:, k : k + 1] for k in range(len(NODES)))
    rise = [x - facing for x in others]
    factors = [sum((row[k] * rise[k] for k in (1, 2)), row[0] * rise[0]) for row in INVERSE]
    means = [
        (facing + (factors[0] * each.first + factors[1] * each.second + factors[2] * each.third)).clamp(0, 1)
        for each in orders
    ]
    return facing, means


def reflected(facing: Tensor, means: Sequence[Tensor], orders: Sequence[Met], fall: Tensor) -> list[Tensor]:
    """What is left of the orders 2, 3 and ≥ 4, with their mean reflectances; each order from 4 on has `fall` of the one
    before it: with x = fall F̄, Σ_{k ≥ 4} (1 − fall) fall^{k−4} of F̄^k and of the k (k − 1) / 2 pairs of facets."""
    two, three, more = means
    together = [each.spread * (F - facing) ** 2 for F, each in zip(means, orders, strict=True)]
    x = fall * more
    left = 1 / (1 - x)
    pairs = together[2] * (6 - x * (8 - 3 * x)) * (left * left)
    return [
        (two * two + together[0]).clamp_min(0),
        (three * (three * three + 3 * together[1])).clamp_min(0),
        ((1 - fall) * left * (more * more) * (more * more + pairs)).clamp_min(0),
    ]
