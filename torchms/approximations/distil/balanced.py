"""Glass whose walks reflect more often than Fresnel's equations say, and weigh that much less.

An estimate of what is reflected at a low index rests on a few reflections; this makes them more frequent.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.estimators import HeightWalk
from torchms.fresnel.dielectric import Dielectric
from torchms.maths.frame import Vec3, dot, reflect, refract, select
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Bounce
from torchms.sampling.stream import Stream

ELEMENTS = 8192
"""Rows × paths that are evaluated at a time."""
LEAST = 0.15
"""Share of the refractions that becomes reflections."""


@dataclass(frozen=True)
class Balanced(Refractive):
    """Facets that reflect with probability F + LEAST (1 − F). For values only: its weights have no gradient."""

    def sample(self, w: Vec3, normal: Vec3, numbers: tuple[Tensor, ...], side: Tensor) -> Bounce[Tensor]:
        eta = self.fresnel.relative_eta(side)
        F = self.reflectance(dot(w, normal), side)[0]
        often = F + LEAST * (1 - F)
        crossed = numbers[0] >= often
        d = select(crossed, -refract(w, normal, eta), reflect(w, normal))
        weight = torch.where(crossed, 1 / (1 - LEAST), F / often)
        return Bounce(d, weight[None], torch.where(crossed, -side, side))


@torch.no_grad()
def balanced_orders(
    distribution: EllipticDistribution, eta: Tensor, wi: Tensor, wo: Tensor, seed: int, n_paths: int, max_order: int
) -> Tensor:
    """f · |cos θ_o| [1/sr] of each order (n, K), without the η² of radiance, by such walks; parameters are (n)."""
    walks, parts = HeightWalk(max_order), []
    ax, ay = distribution.alphas
    for some in torch.arange(len(wi)).split(max(1, ELEMENTS // n_paths)):
        vertex = Balanced(type(distribution)(ax[some], ay[some]), Dielectric(eta[some]))
        seeds = some + (seed << 32)
        numbers = Stream(seeds, n_paths).numbers(seeds, walks.n_uniforms(vertex), wi.dtype)
        i, o = (Vec3(*w[some][None].unbind(-1)) for w in (wi, wo))
        values = [value.mean(1)[0] for value in walks.evaluate(vertex, i, o, numbers)]
        parts.append(torch.stack(torch.broadcast_tensors(*values), -1))
    return torch.cat(parts)
