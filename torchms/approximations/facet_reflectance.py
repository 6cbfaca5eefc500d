"""What the facets reflect that light meets on its way, for any Fresnel term: F at four cosines and a few means.

Over cosines c every reflectance of a metal or of glass is nearly a sum of Schlick's curve s(c) = (1 − c)⁵ from F(1) to F(0)
and of two functions of c that are 0 at both ends,

    F(c) = F(1) + (F(0) − F(1)) s(c) + D(1/2) p(c) + D(0.15) q(c),

with D what F is above that curve, p and q sums of c (1 − c)³ and c (1 − c)⁸ that are 1 at one of the two cosines and 0 at the
other. So the mean reflectance of the facets of order k follows from the means of s, p and q there, whatever F is. Two facets
of one path are not independent: v is the covariance of s at both over the square of its mean, and the mean of a product
F F' is F̄² + v (F̄ − F(1))².
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.network import soft_sign
from torchms.fresnel.base import Fresnel
from torchms.maths.constants import constants

NODES = (1.0, 0.0, 0.5, 0.15)
"""Cosines at which F is looked at."""
MEANS = 4
"""Numbers of an order: three means, and v."""
LEAST_SPREAD = (-1.0, -1 / 3, -1 / 6)
"""Smallest v of the orders 2, 3 and ≥ 4: no product is negative."""
SPAN = 4.0
"""From the smallest to the largest v."""


def _humps(c: Tensor) -> tuple[Tensor, Tensor]:
    x = 1 - c
    x3 = x * x * x
    return c * x3, c * x3 * x3 * x * x


def _inverse() -> list[list[float]]:
    """p and q as sums of the two humps."""
    rows = torch.stack(_humps(torch.tensor(NODES[2:], dtype=torch.float64)))
    return np.linalg.inv(rows.numpy()).tolist()


(P, Q) = _inverse()


def shapes(c: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """s, p and q of cosines c in [0, 1]."""
    x, (a, b) = 1 - c, _humps(c)
    return x * x * x * x * x, P[0] * a + P[1] * b, Q[0] * a + Q[1] * b


def _ranges() -> list[tuple[float, float]]:
    found = shapes(torch.linspace(0, 1, 10001, dtype=torch.float64))[1:]
    return [(float(x.min()), float(x.max() - x.min())) for x in found]


RANGES = _ranges()
"""Smallest value of p and of q, and how much larger the largest one is."""


class Met(NamedTuple):
    """Facets of one order: means of s, p and q [1], and v [1]."""

    s: Tensor
    p: Tensor
    q: Tensor
    spread: Tensor


def met(outputs: Sequence[Tensor]) -> list[Met]:
    """From the outputs of a network, MEANS for each of the orders 2, 3 and ≥ 4."""
    found = []
    for order in range(3):
        a, b, c, d = (0.5 + 0.5 * soft_sign(x) for x in outputs[MEANS * order : MEANS * (order + 1)])
        # s is small where facets are met squarely: its fifth root is learned.
        x = 1 - a
        p, q = (low + span * y for (low, span), y in zip(RANGES, (b, c), strict=True))
        found.append(Met(x * x * x * x * x, p, q, LEAST_SPREAD[order] + SPAN * d))
    return found


def mean_reflectances(fresnel: Fresnel, orders: Sequence[Met]) -> tuple[Tensor, list[Tensor]]:
    """Kernel: F(1), and F̄ of each order, in [0, 1]; channels first, (C, N, …)."""
    like = orders[0].s
    at = fresnel.reflectance(constants(NODES, like).reshape(-1, *(1,) * (like.ndim - 1)))
    facing, grazing, *between = (at[:, k : k + 1] for k in range(len(NODES)))
    rise = grazing - facing
    first, second = (x - facing - (1 - c) ** 5 * rise for x, c in zip(between, NODES[2:], strict=True))
    return facing, [(facing + (rise * m.s + first * m.p + second * m.q)).clamp(0, 1) for m in orders]


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
