"""Directions in which light leaves rough metal after any number of bounces, with their exact density."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, mirrored, plus, reflect, select
from torchms.parameters.exchange import with_parameters
from torchms.sampling.proposals import Proposal, folded_up
from torchms.sampling.warps import cosine_hemisphere

WIDER = 1.2
"""How much rougher a surface looks after another bounce."""
NARROW = 0.9
"""Share of the rougher surface in the rest for q² = 1; a round surface's rest is a cosine lobe."""
MORE = 1.25
"""Samples of the rest for its energy: what one bounce sends to grazing directions, where masking keeps it, is also its."""


@dataclass(frozen=True)
class MetalProposal(Proposal):
    """Reflections of one bounce, and for the rest those of a rougher surface and a cosine lobe."""

    distribution: EllipticDistribution
    n_uniforms = 3

    def rest_share(self, wi: Vec3) -> Tensor:
        """Weight of the rest, in [0.002, 0.9]: MORE of about what one bounce loses, 1 − E(wi)."""
        ax, ay = self.distribution.alphas
        m2 = self.distribution.mean_alpha2
        z2 = wi.z * wi.z
        cos2 = z2 / (z2 + ax * ax * (wi.x * wi.x) + ay * ay * (wi.y * wi.y)).clamp_min(1e-12)
        cos = torch.sqrt(cos2.clamp_min(1e-6))
        # Fitted to the albedo tables: 1 − E at normal incidence, and how it falls with the stretched cosine.
        normal = m2 / (0.6 + 0.85 * m2)
        fall = torch.sqrt(cos) * (1.18 - 0.18 * cos)
        tilt = 0.15 * (1 - cos2) * torch.sqrt(cos) * (1 - normal)
        return (MORE * (normal * fall + tilt)).clamp(0.002, 0.9)

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
        return select(u[0] < self._flat(), cosine_hemisphere(u[1], u[2]), wide)

    def rest_density(self, wi: Vec3, wo: Vec3) -> Tensor:
        """Density of `sample_rest` at `wo` [1/sr], both above the horizon."""
        flat = self._flat()
        return flat * wo.z / math.pi + (1 - flat) * _folded(self._wider(), wi, wo)

    def _flat(self) -> Tensor:
        """Share of the cosine lobe in the rest."""
        ax, ay = self.distribution.alphas
        q = (ax - ay) / (ax + ay)
        return 1 - NARROW * (q * q)

    def _wider(self) -> EllipticDistribution:
        """The rougher surface."""
        names = ("alpha",) if self.distribution.alpha_y is None else ("alpha", "alpha_y")
        return with_parameters(self.distribution, {name: WIDER * getattr(self.distribution, name) for name in names})


def _folded(distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Tensor:
    """Density of reflections, those that end below folded up."""
    up = distribution.reflecting_density(wi, plus(wi, wo))
    return up + distribution.reflecting_density(wi, plus(wi, mirrored(wo)))
