"""What must leave with the rest: energies of directions of incidence, by quadrature over the outgoing ones."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.albedo_table import AlbedoTable
from torchms.approximations.distil.rows import KINDS, Rows
from torchms.approximations.distil.weights import Inputs
from torchms.approximations.metal_sampling import MetalProposal
from torchms.maths.frame import Vec3, split
from torchms.sampling.uniforms import draw, generator_for

POINTS = 2048
"""Outgoing directions of one cell: scrambled Sobol points, close to the rest's shape."""


class Cells(NamedTuple):
    """inputs of c · K pairs; weights (c · K), cos θ_o dω of each; lost (c), what leaves after more than one bounce."""

    inputs: Inputs
    weights: Tensor
    lost: Tensor

    @property
    def points(self) -> int:
        """K."""
        return max(len(self.weights) // max(len(self.lost), 1), 1)

    def part(self, first: int, count: int) -> "Cells":
        """`count` of the cells."""
        points = slice(first * self.points, (first + count) * self.points)
        return Cells(self.inputs.part(points), self.weights[points], self.lost[first : first + count])

    def energies(self, f: Tensor) -> Tensor:
        """∫ f cos θ_o dω [1] of each cell (c), from f [1/sr] at its points."""
        return (f * self.weights).reshape(-1, self.points).sum(-1)


@torch.no_grad()
def pairs(kind: str, where: Rows, seed: int) -> tuple[Rows, Tensor, Tensor]:
    """Pairs (c · POINTS), their weights cos θ_o / density / POINTS, and what one bounce loses (c)."""
    count = len(where.ax)
    u = draw((count,), POINTS, 3, generator=generator_for(seed), sequence="sobol")
    found: list[list[Tensor]] = [[], [], [], [], []]
    for some in torch.arange(count).split(64):
        distribution = KINDS[kind](where.ax[some, None], where.ay[some, None])
        wi = split(where.wi[some, None])
        proposal = MetalProposal(distribution)
        wo = proposal.sample_rest(wi, u[some].unbind(-1))
        wo = Vec3(wo.x, wo.y, wo.z.clamp_min(1e-5))
        parts = torch.broadcast_tensors(*distribution.alphas, *wi, *wo, wo.z / proposal.rest_density(wi, wo) / POINTS)
        ax, ay, *components, weight = (x.reshape(-1) for x in parts)
        columns = ax, ay, torch.stack(components[:3], -1), torch.stack(components[3:], -1), weight
        for column, x in zip(found, columns, strict=True):
            column.append(x)
    ax, ay, wi, wo, weight = (torch.cat(column) for column in found)
    one = KINDS[kind](where.ax, where.ay)
    return Rows(ax, ay, wi, wo), weight, AlbedoTable.packaged(kind).loss(one, split(where.wi))
