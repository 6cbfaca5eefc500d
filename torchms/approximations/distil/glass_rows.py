"""Where the distillation of glass looks: surfaces, directions of incidence, and whole lobes on either side of each."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.coordinates import ETA
from torchms.approximations.distil import scenes
from torchms.approximations.distil.rows import KINDS, LEAST_COSINE
from torchms.approximations.glass_sampling import GlassRest
from torchms.approximations.metal_sampling import MetalProposal
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel import Dielectric
from torchms.maths.frame import Vec3, join, scaled, select, split
from torchms.paths.refractive import Refractive
from torchms.sampling.proposals import DielectricProposal
from torchms.sampling.uniforms import draw
from torchms.sampling.warps import cosine_hemisphere

LEAST_LOG = 0.015
"""Smallest |ln η|."""
MARGIN = 1.03
"""Factor by which roughnesses and indices reach beyond the range, so that its ends are no ends of the training."""
FLAT, WIDE = 0.3, 0.35
"""Shares of a cosine lobe and of a rougher surface in the transmitted directions."""


class Surfaces(NamedTuple):
    """α_x, α_y and η = n below / n above (n), and a direction of incidence above each (n, 3)."""

    ax: Tensor
    ay: Tensor
    eta: Tensor
    wi: Tensor

    def repeated(self, count: int) -> "Surfaces":
        """Each of them so many times."""
        return Surfaces(*(x.repeat_interleave(count, 0) for x in self))

    def part(self, rows: Tensor | slice) -> "Surfaces":
        """Some of them."""
        return Surfaces(*(x[rows] for x in self))

    def distribution(self, kind: str) -> EllipticDistribution:
        """The facets."""
        return KINDS[kind](self.ax, self.ay)


class Lobes(NamedTuple):
    """Outgoing directions (n, K, 3), and 1 / density / K (n, K) [sr]; 0 for one that stands in for none."""

    wo: Tensor
    weights: Tensor


def drawn(alpha: tuple[float, float], count: int, generator: torch.Generator) -> Surfaces:
    """`count` of them; α and η mostly evenly in their logarithms, more grazing light than there is."""
    reach = max(alpha[0] / MARGIN, 1e-3), min(alpha[1] * MARGIN, 2.0)
    ax, ay = scenes.roughnesses(reach, count, 0.4, generator)
    eta = scenes.indices(count, LEAST_LOG, ETA * MARGIN, generator)
    return Surfaces(ax, ay, eta, scenes.hemisphere(count, generator))


@torch.no_grad()
def lobes(kind: str, where: Surfaces, up: bool, count: int, generator: torch.Generator) -> Lobes:
    """`count` directions above, or below, of each, close to the shape of what leaves there."""
    u = draw((len(where.ax),), count, 5, generator=generator, sequence="sobol").unbind(-1)
    distribution, wi = KINDS[kind](where.ax[:, None], where.ay[:, None]), split(where.wi[:, None])
    if up:
        proposal = MetalProposal(distribution)
        wo = proposal.sample(wi, u)
        wo = Vec3(wo.x, wo.y, wo.z.clamp_min(LEAST_COSINE))
        return _lobes(wo, 1 / proposal.density(wi, wo))
    vertex = Refractive(distribution, Dielectric(where.eta[:, None]))
    plain, wide = DielectricProposal(vertex), GlassRest(vertex).wider
    wo = select(u[4] < FLAT, scaled(cosine_hemisphere(u[1], u[2]), -torch.ones_like(u[0])), plain.sample(wi, u))
    wo = select(u[4] > 1 - WIDE, wide.sample(wi, u), wo)
    below = wo.z < 0
    # What was drawn above stands in for a direction below that is not counted.
    wo = Vec3(wo.x, wo.y, -wo.z.abs().clamp_min(LEAST_COSINE))
    flat = FLAT / torch.pi * wo.z.abs()
    density = flat + (1 - FLAT - WIDE) * plain.density(wi, wo) + WIDE * wide.density(wi, wo)
    return _lobes(wo, below / density)


def _lobes(wo: Vec3, weights: Tensor) -> Lobes:
    joined, weights = join(wo), weights / weights.shape[1]
    return Lobes(joined, weights.expand(joined.shape[:2]))
