"""Directions in which light leaves a layer and the base below it, with their exact density."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.maths.frame import Vec3, select
from torchms.sampling.proposals import Proposal
from torchms.sampling.warps import cosine_hemisphere

MOST = 0.95
"""Largest share of the base: what facets reflect at grazing angles is never rare."""


@dataclass(frozen=True)
class LayeredProposal(Proposal):
    """Those of the `facets`, and a cosine lobe for the base. f0: the facets' reflectance at normal incidence; base: the
    albedo of the base, with its share of what they let through; both means over the channels, (*batch)."""

    facets: Proposal
    f0: Tensor
    base: Tensor

    @property
    def n_uniforms(self) -> int:  # type: ignore[override]
        return self.facets.n_uniforms + 1

    def base_share(self, wi: Vec3) -> Tensor:
        """How often light comes from the base: about its share of what leaves."""
        x = 1 - wi.z.clamp_min(0)
        x = x * x * x * x * x
        base = self.base * (1 - x)
        return (base / (base + self.f0 + (1 - self.f0) * x).clamp_min(1e-6)).clamp_max(MOST)

    def sample(self, wi: Vec3, u: Sequence[Tensor]) -> Vec3:
        *own, choice = u[: self.n_uniforms]
        return select(choice < self.base_share(wi), cosine_hemisphere(u[0], u[1]), self.facets.sample(wi, own))

    def from_three(self, wi: Vec3, u0: Tensor, u1: Tensor, u2: Tensor) -> list[Tensor]:
        share = self.base_share(wi)
        again = torch.where(u0 < share, u0 / torch.where(share > 0, share, 1.0), (u0 - share) / (1 - share))
        return [*self.facets.from_three(wi, again, u1, u2), u0]

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        share = self.base_share(wi)
        found = (1 - share) * self.facets.density(wi, wo) + share * (wo.z / math.pi)
        return torch.where((wi.z > 0) & (wo.z > 0), found, 0.0)
