"""Where a distillation looks: roughnesses and pairs of directions."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions import GGX, Beckmann
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, join, normalized, reflect
from torchms.sampling.uniforms import draw

KINDS: dict[str, type[EllipticDistribution]] = {"GGX": GGX, "Beckmann": Beckmann}
LEAST_COSINE = 1e-4
MARGIN = 1.06
"""Factor by which roughnesses reach beyond the range at either end, so that its ends are no ends of the training."""


class Rows(NamedTuple):
    """Surfaces and pairs of directions above the horizon: α_x and α_y (n), wi and wo (n, 3)."""

    ax: Tensor
    ay: Tensor
    wi: Tensor
    wo: Tensor

    def part(self, rows: slice) -> "Rows":
        """Some of them."""
        return Rows(*(x[rows] for x in self))


def drawn(kind: str, alpha: tuple[float, float], n: int, generator: torch.Generator) -> Rows:
    """`n` of them: more rough surfaces than smooth ones, a quarter isotropic; more grazing directions than there are.

    Six of ten wo are reflected twice off visible facets, near which the lobes of anisotropic surfaces lie; the rest is
    anywhere.
    """
    u = draw((n,), 1, 15, generator=generator)[:, 0].unbind(-1)
    low, high = max(alpha[0] / MARGIN, 1e-3), min(alpha[1] * MARGIN, 2.0)
    ax, ay = (low * (high / low) ** (x**0.6) for x in u[:2])
    ay = torch.where(u[2] < 0.25, ax, ay)
    wi = _direction(torch.where(u[3] < 0.35, u[4] * u[4], u[4]), u[5])
    anywhere = _direction(torch.where(u[6] < 0.25, u[7] * u[7], u[7]), u[8])
    distribution = KINDS[kind](ax.clamp(1e-3, 2.0), ay.clamp(1e-3, 2.0))
    w = wi
    for a, b in ((u[9], u[10]), (u[11], u[12])):
        d = reflect(w, distribution.visible_normal(w, a, b))
        w = Vec3(-d.x, -d.y, -d.z)
    again = normalized(Vec3(w.x, w.y, w.z.abs().clamp_min(LEAST_COSINE)))
    near = u[13] < 0.6
    wo = Vec3(*(torch.where(near, a, b) for a, b in zip(again, anywhere, strict=True)))
    return Rows(distribution.alpha, distribution.alphas[1], join(wi), join(wo))


def _direction(z: Tensor, turn: Tensor) -> Vec3:
    z = z.clamp_min(LEAST_COSINE)
    r = (1 - z * z).clamp_min(0).sqrt()
    return Vec3(r * torch.cos(2 * math.pi * turn), r * torch.sin(2 * math.pi * turn), z)
