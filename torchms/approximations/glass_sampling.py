"""Directions in which light leaves rough glass after more than one bounce, with their exact density."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, scaled, select
from torchms.parameters.exchange import with_parameters
from torchms.paths.refractive import Refractive
from torchms.sampling.proposals import DielectricProposal, Proposal
from torchms.sampling.warps import cosine_hemisphere

WIDER = 1.45
"""How much rougher a surface looks after another bounce: slopes of two facets add up to √2 times one, and some more."""
FLAT = 0.5
"""Share of the cosine lobes."""


@dataclass(frozen=True)
class GlassRest(Proposal):
    """One bounce off a rougher surface, and a cosine lobe on either side."""

    vertex: Refractive
    n_uniforms = 4

    def share(self, wi: Vec3) -> Tensor:
        """How often light leaves with the rest: about what one bounce loses; between 0.05 and 0.8."""
        distribution = self.vertex.distribution
        assert isinstance(distribution, EllipticDistribution)
        s = distribution.stretched(wi)
        slope2 = s.x * s.x + s.y * s.y
        return (0.05 + slope2 / (slope2 + wi.z * wi.z) + 0.3 * distribution.mean_alpha2).clamp_max(0.8)

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        flat = u[0] < FLAT
        # The number that chose is uniform again, once it is stretched to [0, 1).
        again = torch.where(flat, u[0] / FLAT, (u[0] - FLAT) / (1 - FLAT))
        lobe = cosine_hemisphere(u[1], u[2])
        lobe = scaled(lobe, torch.where(u[3] < 0.5, -1.0, 1.0).to(lobe.z.dtype))
        return select(flat, lobe, self.wider.sample(wi, [again, u[1], u[2], u[3]]))

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        flat = (0.5 / math.pi) * wo.z.abs()
        return FLAT * flat + (1 - FLAT) * self.wider.density(wi, wo)

    @property
    def wider(self) -> DielectricProposal:
        """That of the rougher surface."""
        distribution = self.vertex.distribution
        assert isinstance(distribution, EllipticDistribution)
        names = ("alpha",) if distribution.alpha_y is None else ("alpha", "alpha_y")
        wider = with_parameters(distribution, {name: WIDER * getattr(distribution, name) for name in names})
        return DielectricProposal(Refractive(wider, self.vertex.fresnel))
