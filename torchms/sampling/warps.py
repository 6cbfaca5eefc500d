"""Maps from uniform numbers to directions."""

import math

import torch
from torch import Tensor

from torchms.maths.frame import Vec3
from torchms.maths.numerics import safe_sqrt


def cosine_hemisphere(u0: Tensor, u1: Tensor) -> Vec3:
    """A direction above the horizon with density cos θ / π."""
    phi, r = (2 * math.pi) * u0, safe_sqrt(u1)
    return Vec3(r * torch.cos(phi), r * torch.sin(phi), safe_sqrt(1 - u1))


def uniform_hemisphere(u0: Tensor, u1: Tensor) -> Vec3:
    """A direction above the horizon with density 1 / 2π."""
    phi, z = (2 * math.pi) * u0, 1 - u1
    r = safe_sqrt(u1 * (2 - u1))
    return Vec3(r * torch.cos(phi), r * torch.sin(phi), z)
