"""Glass whose walks reflect more often than Fresnel's equations say, and weigh that much less.

An estimate of what is reflected at a low index rests on a few reflections; this makes them more frequent.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.bsdfs.rough_dielectric import RoughDielectric
from torchms.fresnel.dielectric import fresnel_dielectric
from torchms.maths.frame import Vec3, dot, reflect, refract, select
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Bounce

LEAST = 0.15
"""Share of the refractions that becomes reflections."""


@dataclass(frozen=True)
class Balanced(Refractive):
    """Facets that reflect with probability F + LEAST (1 − F). For values only: its weights have no gradient."""

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor | None) -> Bounce:
        assert side is not None
        eta = self.relative_eta(side)
        F, _ = fresnel_dielectric(dot(w, normal).clamp(0.0, 1.0), eta)
        often = F + LEAST * (1 - F)
        crossed = numbers[0] >= often
        d = select(crossed, -refract(w, normal, eta), reflect(w, normal))
        weight = torch.where(crossed, 1 / (1 - LEAST), F / often)
        return Bounce(d, weight[None], crossed, torch.where(crossed, -side, side))


class BalancedGlass(RoughDielectric):
    """`RoughDielectric` of such facets."""

    @property
    def vertex(self) -> Balanced:
        return Balanced(self.distribution, self.fresnel.eta)
