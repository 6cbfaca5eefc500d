"""The kernels of a mixture of Gaussian slopes: each component is a Beckmann surface that is sheared and tilted.

A slope of component k is μ + A t with t of density e^{−|t|²} / π and A lower triangular. For a direction w,

    ⟨w, m⟩ / m_z = w_z − w_xy · slope = (w_z − w_xy · μ) − (Aᵀ w_xy) · t,

so component k sees w as a Beckmann surface of α = 1 sees s_k = (Aᵀ w_xy, w_z − w_xy · μ). The area σ of the mixture is the
weighted sum of theirs, on the whole sphere, and a facet that is visible from w is of component k with probability
weight_k σ(s_k) / σ(w). The components lie along a new first axis.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.gaussian_slopes import gaussian_area
from torchms.maths.frame import Vec3
from torchms.maths.numerics import smallest
from torchms.maths.special import constant


class Components(NamedTuple):
    """Numbers (K, 1, …) of the components; the means sum to 0."""

    weight: Tensor
    x: Tensor  # μ
    y: Tensor
    xx: Tensor  # A = ((xx, 0), (xy, yy))
    xy: Tensor
    yy: Tensor

    @staticmethod
    def of(table: Tensor, ndim: int, dtype: torch.dtype | None = None) -> "Components":
        """From `table` (6, K), to stand beside tensors of `ndim` axes and of this dtype."""
        weight, x, y, *rest = table if dtype is None else table.to(torch.promote_types(table.dtype, dtype))
        # Whatever the numbers were rounded to, what is seen from above is w_z more than from below: σ(w) − σ(−w) = w_z.
        weight = weight / weight.sum()
        parts = (weight, x - (weight * x).sum(), y - (weight * y).sum(), *rest)
        return Components(*(part.reshape(-1, *(1,) * ndim) for part in parts))

    def seen(self, w: Vec3) -> Vec3:
        """s_k, (K, …)."""
        return Vec3(self.xx * w.x + self.xy * w.y, self.yy * w.y, w.z - self.x * w.x - self.y * w.y)

    def picked(self, chosen: Tensor) -> "Components":
        """Of one component an element, by the mask `chosen` (K, …)."""
        return Components(*(torch.where(chosen, part, 0.0).sum(0) for part in self))


class Seen(NamedTuple):
    """Areas weight_k σ(s_k) e^{shift}, (K, …), and the shift, which keeps them from all being 0 where w descends steeply."""

    areas: Tensor
    shift: Tensor

    @property
    def area(self) -> Tensor:
        """σ(w) e^{shift}."""
        return self.areas.sum(0)


def seen(parts: Components, s: Vec3) -> Seen:
    """What each component shows of its facets."""
    z, below, c2, tail = gaussian_area(s)
    # Where no component's mean facet is seen from its front, all areas have a factor e^{−c²}.
    shift = torch.where(below, c2, 0.0).amin(0)
    downward = torch.exp(torch.where(below, shift - c2, -c2)) * tail
    return Seen(parts.weight * torch.where(below, downward, z + downward), shift)


def slope_density(parts: Components, p: Tensor, q: Tensor, shift: Tensor | float) -> Tensor:
    """Density of the slopes (p, q), times e^{shift}."""
    u = (p - parts.x) / parts.xx
    v = ((q - parts.y) - parts.xy * u) / parts.yy
    norm = parts.weight / (constant(math.pi, p) * parts.xx * parts.yy)
    return (norm * torch.exp(shift - (u * u + v * v))).sum(0)


def chosen(areas: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """A component by its share of the areas, as a mask (K, …), and what is left of the random number, in [0, 1)."""
    running = torch.cumsum(areas, 0)
    target = u * running[-1]
    count = (running <= target).to(u.dtype).sum(0).clamp_max(len(areas) - 1)
    number = torch.arange(len(areas), dtype=u.dtype, device=u.device).reshape(-1, *(1,) * (areas.ndim - 1))
    mask = number == count
    area = torch.where(mask, areas, 0.0).sum(0)
    before = torch.where(number < count, areas, 0.0).sum(0)
    ok = area > smallest(area.dtype)
    rest = torch.where(ok, (target - before) / torch.where(ok, area, 1.0), 0.5)
    return mask, rest.clamp(0, 1 - torch.finfo(u.dtype).eps / 2)
