"""Smith's lobes of facets that reflect all light, order by order and without noise: what a correction starts from."""

import torch
from torch import Tensor

from torchms.approximations.diffuse_lobes import DiffuseLobes
from torchms.approximations.distil.rows import Rows
from torchms.approximations.distilled import packaged
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.metal_lobes import MetalLobes
from torchms.distributions import Beckmann
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators import SingleBounce
from torchms.fresnel import Ideal
from torchms.maths.frame import Vec3, split
from torchms.paths.mirror import Mirror

CHUNK = 8192


def beckmann() -> Distillate:
    """All bounces between Beckmann facets, from the second on."""
    return packaged("Beckmann", "metal")


@torch.no_grad()
def smith_orders(rows: Rows, first: MicrofacetDistribution | None = None) -> Tensor:
    """f cos θ_o [1/sr] (n, 4) of one, two, three and more bounces.

    first: whose facets the only bounce of a path meets, if they are not Beckmann's.
    """
    lobes, single, parts = MetalLobes(beckmann()), SingleBounce(), []
    for begin in range(0, len(rows.ax), CHUNK):
        some = rows.part(slice(begin, begin + CHUNK))
        distribution = Beckmann(some.ax, some.ay)
        wi, wo = (Vec3(*(x[None] for x in split(w))) for w in (some.wi, some.wo))
        vertex = Mirror(distribution if first is None else first, Ideal())
        orders = [*single.evaluate(vertex, wi, wo, ()), *lobes.orders(distribution, vertex.fresnel, wi, wo)]
        parts.append(torch.stack([order[0, 0] for order in orders], -1))
    return torch.cat(parts)


@torch.no_grad()
def smith_diffuse(rows: Rows) -> Tensor:
    """f cos θ_o [1/sr] (n, 4) of one, two, three and more bounces between diffuse facets."""
    lobes, parts = DiffuseLobes(packaged("Beckmann", "diffuse")), []
    for begin in range(0, len(rows.ax), CHUNK):
        some = rows.part(slice(begin, begin + CHUNK))
        found, _ = lobes.white(Beckmann(some.ax, some.ay), split(some.wi), split(some.wo))
        parts.append(torch.stack(found, -1))
    return torch.cat(parts)
