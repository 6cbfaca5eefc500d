"""Where a distillation looks: roughnesses and pairs of directions."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.metal_sampling import MetalProposal
from torchms.distributions import GGX, Beckmann
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, join, split
from torchms.sampling.uniforms import draw

KINDS: dict[str, type[EllipticDistribution]] = {"GGX": GGX, "Beckmann": Beckmann}
LEAST_COSINE = 1e-4
OUTGOING = 64
"""Outgoing directions for each direction of incidence."""
MARGIN = 1.03
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


def surfaces(alpha: tuple[float, float], count: int, generator: torch.Generator) -> Rows:
    """`count` surfaces and directions of incidence; wo is left at wi.

    More rough surfaces than smooth ones, three of ten isotropic; more grazing directions than there are.
    """
    u = draw((count,), 1, 6, generator=generator)[:, 0].unbind(-1)
    low, high = max(alpha[0] / MARGIN, 1e-3), min(alpha[1] * MARGIN, 2.0)
    ax, ay = (low * (high / low) ** (x**0.75) for x in u[:2])
    ay = torch.where(u[2] < 0.3, ax, ay)
    wi = join(_direction(torch.where(u[3] < 0.35, u[4] * u[4], u[4]), u[5]))
    return Rows(ax, ay, wi, wi)


def drawn(kind: str, alpha: tuple[float, float], n: int, generator: torch.Generator) -> tuple[Rows, Tensor]:
    """`n` of them, OUTGOING for each direction of incidence, from the lobes that `Distilled` samples.

    And cos² θ_o / density (n) [sr]: the mean over the wo of one wi of that times f² is the lobe's square, integrated.
    """
    where = surfaces(alpha, n // OUTGOING, generator)
    u = draw((n // OUTGOING,), OUTGOING, 3, generator=generator, sequence="sobol").unbind(-1)
    distribution, wi = KINDS[kind](where.ax[:, None], where.ay[:, None]), split(where.wi[:, None])
    proposal = MetalProposal(distribution)
    wo = proposal.sample(wi, u)
    wo = Vec3(wo.x, wo.y, wo.z.clamp_min(LEAST_COSINE))
    density = proposal.density(wi, wo)
    ax, ay, incident = (x.repeat_interleave(OUTGOING, 0) for x in (where.ax, where.ay, where.wi))
    return Rows(ax, ay, incident, join(wo).reshape(-1, 3)), (wo.z * wo.z / density).reshape(-1)


def _direction(z: Tensor, turn: Tensor) -> Vec3:
    z = z.clamp_min(LEAST_COSINE)
    r = (1 - z * z).clamp_min(0).sqrt()
    return Vec3(r * torch.cos(2 * math.pi * turn), r * torch.sin(2 * math.pi * turn), z)
