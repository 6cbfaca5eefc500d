"""Directions in which light leaves rough metal after any number of bounces, with their exact density."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, half_vector, mirrored, reflect, select
from torchms.parameters.exchange import with_parameters
from torchms.sampling.proposals import Proposal, folded_up
from torchms.sampling.warps import cosine_hemisphere

WIDER = 1.45
"""How much rougher a surface looks after another bounce: slopes of two facets add up to √2 times one, and some more."""
FLAT = 0.5
"""Share of the cosine lobe in the rest."""


@dataclass(frozen=True)
class MetalProposal(Proposal):
    """Reflections of one bounce, and for the rest those of a rougher surface and a cosine lobe."""

    distribution: EllipticDistribution
    n_uniforms = 3

    def rest_share(self, wi: Vec3) -> Tensor:
        """Weight of the rest: about what one bounce loses, 1 − E(wi); between 0.002 and 0.8."""
        ax, ay = self.distribution.alphas
        s2 = ax * ax * (wi.x * wi.x) + ay * ay * (wi.y * wi.y)
        z2 = wi.z * wi.z
        m2 = (ax * ax + ay * ay) / 2
        cos2 = z2 / (z2 + s2).clamp_min(1e-12)
        tilt = (1 - cos2) * 0.35 * torch.sqrt(cos2.clamp_min(1e-6))
        return (0.002 + m2 / (0.45 + m2) * torch.sqrt(cos2.clamp_min(1e-6)) + tilt).clamp(0.002, 0.8)

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        q = self.rest_share(wi)
        again = u[0] < q
        # The number that chose is uniform again, once it is stretched to [0, 1).
        rest = self.sample_rest(wi, [u[0] / q, u[1], u[2]])
        single = folded_up(reflect(wi, self.distribution.reflecting_normal(wi, u[1], u[2])))
        return select(again, rest, single)

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        q = self.rest_share(wi)
        found = (1 - q) * _folded(self.distribution, wi, wo) + q * self.rest_density(wi, wo)
        return torch.where((wi.z > 0) & (wo.z > 0), found, 0.0)

    def sample_rest(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        """A direction with density `rest_density`."""
        wide = folded_up(reflect(wi, self._wider().reflecting_normal(wi, u[1], u[2])))
        return select(u[0] < FLAT, cosine_hemisphere(u[1], u[2]), wide)

    def rest_density(self, wi: Vec3, wo: Vec3) -> Tensor:
        """Density of `sample_rest` at `wo` [1/sr], both above the horizon."""
        return FLAT * wo.z / math.pi + (1 - FLAT) * _folded(self._wider(), wi, wo)

    def _wider(self) -> EllipticDistribution:
        """The rougher surface."""
        names = ("alpha",) if self.distribution.alpha_y is None else ("alpha", "alpha_y")
        return with_parameters(self.distribution, {name: WIDER * getattr(self.distribution, name) for name in names})


def _folded(distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Tensor:
    """Density of reflections, those that end below folded up."""
    up = distribution.reflecting_density(wi, half_vector(wi, wo))
    return up + distribution.reflecting_density(wi, half_vector(wi, mirrored(wo)))
