"""What a distilled lobe is a function of: numbers of two directions that have the symmetries of the surface.

Mirroring x or y of both directions changes none of them, nor does exchanging x and y together with α_x and α_y: with
q = (α_x − α_y) / (α_x + α_y), which changes its sign, a pair of numbers (a_x, a_y) enters as a_x + a_y and as q (a_x − a_y).
For α_x = α_y the latter are 0, and what is left does not depend on the azimuth of the pair.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon

ROUGHNESS = (0.03, 1.0)
"""Range of α_x and α_y that lobes are distilled for."""


class Seen(NamedTuple):
    """One direction w above the horizon: w itself, σ(w), w_z / σ(w), the stretched w_z and its stretched length."""

    w: Vec3
    area: Tensor
    masking: Tensor
    height: Tensor
    length: Tensor


class Shape(NamedTuple):
    """The roughness: α_x, α_y, α_x + α_y, ln √(α_x α_y) and q."""

    ax: Tensor
    ay: Tensor
    sum: Tensor
    log: Tensor
    q: Tensor


def shape_of(distribution: EllipticDistribution) -> Shape:
    """The roughness of `distribution`."""
    ax, ay = distribution.alphas
    if distribution.alpha_y is None:
        return Shape(ax, ax, 2 * ax, torch.log(ax), torch.zeros_like(ax))
    total = ax + ay
    return Shape(ax, ay, total, 0.5 * torch.log(ax * ay), (ax - ay) / total)


def above(w: Vec3) -> Vec3:
    """`w`, and the normal in place of what is not above the horizon: nothing there is divided by."""
    up = w.z >= horizon(w.z.dtype)
    return Vec3(torch.where(up, w.x, 0.0), torch.where(up, w.y, 0.0), torch.where(up, w.z, 1.0))


def seen(distribution: EllipticDistribution, w: Vec3) -> Seen:
    """What a direction above the horizon brings."""
    s = distribution.stretched(w)
    length = torch.sqrt(s.x * s.x + s.y * s.y + s.z * s.z)
    area = distribution.projected_area(w)
    return Seen(w, area, w.z / area, w.z / length, length)


def root_sign(x: Tensor, width: float = 1.0) -> Tensor:
    """x / √(x² + width²): a step without a corner."""
    return x * torch.rsqrt(x * x + width * width)


def facing(shape: Shape, a: Seen, b: Seen) -> tuple[Tensor, Tensor, Tensor]:
    """a · b in the plane, q times its difference of axes, and the plane's part of the stretched a · b."""
    xx, yy = a.w.x * b.w.x, a.w.y * b.w.y
    stretched = shape.ax * shape.ax * xx + shape.ay * shape.ay * yy
    return xx + yy, shape.q * (xx - yy), stretched / (a.length * b.length)


def slanted(shape: Shape, w: Vec3) -> Tensor:
    """q (x² − y²): which axis a direction leans to."""
    return shape.q * (w.x * w.x - w.y * w.y)


def half_vector_features(shape: Shape, p: Vec3) -> tuple[Tensor, Tensor, Tensor]:
    """Of the normal along p that would do it in one bounce: −½ ln(π α_x α_y D_GGX), its height, and |p|²."""
    least = 1e-12
    x2, y2, z2 = p.x * p.x, p.y * p.y, p.z * p.z
    length2 = x2 + y2 + z2 + least
    ratio = shape.ax / shape.ay
    form = x2 / ratio + y2 * ratio + z2 * (shape.ax * shape.ay) + least
    return torch.log(form / length2), p.z * torch.rsqrt(length2), length2


def shared(shape: Shape, i: Seen, o: Seen, along: Tensor, across: Tensor, stretched: Tensor) -> list[Tensor]:
    """The features that the networks of diffuse facets and of glass have in common, from those of `facing`."""
    return [
        i.w.z + o.w.z,
        i.w.z * o.w.z,
        i.masking + o.masking,
        i.masking * o.masking,
        along,
        stretched,
        shape.log,
        shape.sum,
        shape.q * shape.q,
        slanted(shape, i.w) + slanted(shape, o.w),
        across,
        i.height + o.height,
        i.height * o.height,
    ]
