"""Detached sampling: what a walk drew is held constant, and its weight has the gradient instead.

A value ∫ f(x; θ) dx is estimated by f / p with x drawn from p. If x follows θ ("attached": fixed random numbers), the
gradient of the estimate misses whatever moves across a jump of f: for GGX, D(h) jumps to 0 at h_z = 0, from 1/π at α = 1.
If x is held ("detached"), f(x; θ) / p(x; θ_0) is differentiated: a bounce weighs phase(w, d; θ) / density(w, d; θ_0).

The jumps themselves move with wi and wo, and with η. A bounce changes n · d along the facet's normal, n the index where the
light runs, so h_z = 0 where n · d_z stays what it was. Directions are therefore held relative to the ends of the path: the
heights n · d_z of a path go through one increasing map, under which no two of them change their order.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.frame import Vec3
from torchms.maths.numerics import differentiated, score, smallest

Anchors = Sequence[Tensor]
"""Heights n · d_z that the map follows: those of a path's ends, and ±n, between which all others are."""


class Detached(NamedTuple):
    """A direction that is held, and what the solid angle around it grows by [1] (1, with a gradient); None for nothing."""

    d: Vec3
    growth: Tensor | None


def constant(d: Vec3) -> Vec3:
    """`d` without its gradient."""
    return Vec3(d.x.detach(), d.y.detach(), d.z.detach())


def detached(d: Vec3, anchors: Anchors, n: Tensor | None = None) -> Detached:
    """`d` held relative to the `anchors`: its height n · d_z goes along with the two next to it, linearly between them.

    n: the index where the light runs, times ±1 if d is not in the frame of the anchors; None for 1.
    """
    d = constant(d)
    if not differentiated(*anchors):
        return Detached(d, None)
    n = torch.ones_like(d.z) if n is None else n
    height = (n * d.z).detach()
    stack = torch.stack(torch.broadcast_tensors(*anchors, height))[:-1]
    below = stack.detach() <= height
    low = torch.where(below, stack, -torch.inf).amax(0)
    high = torch.where(below, torch.inf, stack).amin(0)
    length = high - low
    between = length.detach().isfinite() & (length.detach() > smallest(length.dtype) ** 0.5)
    low, length = torch.where(between, low, 0.0), torch.where(between, length, 1.0)
    t = ((height - low) / length).detach()
    z = torch.where(between, (low + t * length) / n, d.z)
    # 1 − z² as its two factors: neither cancels where the height and an anchor are at the pole together.
    shrunk = torch.sqrt(score(1 - z) * score(1 + z))
    return Detached(Vec3(d.x * shrunk, d.y * shrunk, z), torch.where(between, score(length) / score(n.abs()), 1.0))
