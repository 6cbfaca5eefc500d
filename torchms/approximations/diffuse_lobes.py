"""All bounces between diffuse facets as smooth functions of both directions: no random numbers, no noise.

f_k is the lobe of order k for an albedo ρ of 1. With Smith's masking the first is

    f_1 = σ_i σ_o exp(n_1) / (π (σ_i z_o + σ_o z_i − z_i z_o)),   σ_i σ_o exp(n_1) = ∫ ⟨i, m⟩ ⟨o, m⟩ D(m) dm,

f_2 and f_3 are exp(n_k) / π, and all further ones together exp(n_4) / π: they fall off by a factor λ an order, so for
another albedo they are ρ⁴ (1 − λ) / (1 − λ ρ) of that. n_1 … n_4 and λ come from one network of symmetric numbers.
"""

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor, nn

from torchms.approximations import pair_features as pair
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.network import Network
from torchms.distributions.base import EllipticDistribution
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon
from torchms.parameters.declared import channels_first
from torchms.paths.diffuse import Diffuse
from torchms.sampling.warps import cosine_hemisphere

FEATURES = 14
OUTPUTS = 5
EXPONENT = (-30.0, 2.0)
"""Range of the exponents: no lobe that was seen in training leaves it, and none overflows next to the horizon."""


def features(shape: pair.Shape, i: pair.Seen, o: pair.Seen) -> list[Tensor]:
    """The network's inputs, symmetric in both directions."""
    along, across, stretched = pair.facing(shape, i, o)
    z = i.w.z * o.w.z
    return [
        *pair.shared(shape, i, o, along, across, stretched),
        torch.sqrt((along + z + 1.0001) * 0.5),
    ]


def smith(distribution: EllipticDistribution, i: pair.Seen, o: pair.Seen) -> Tensor:
    """σ_i σ_o / (σ_i z_o + σ_o z_i − z_i z_o): what masking and shadowing make of one bounce."""
    # σ(−o) = σ(o) − z_o ≥ 0, without cancellation.
    both = i.area * o.w.z + distribution.projected_area(-o.w) * i.w.z
    return i.area * o.area / both.clamp_min(horizon(both.dtype) ** 2)


class DiffuseLobes(nn.Module):
    """Lobes of rough diffuse surfaces of one kind of distribution, from a network."""

    n_extra = 0

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        self.network = Network(distillate.layers, distillate.skip, pair.root_sign)

    def distribution_of(self, vertex: Diffuse) -> EllipticDistribution:
        """Whose facets the lobes are of."""
        assert isinstance(vertex.distribution, EllipticDistribution)
        return vertex.distribution

    def white(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> tuple[list[Tensor], Tensor]:
        """f · cos θ_o [1/sr] of the orders 1, 2, 3 and of all others at albedo 1, and λ; both above the horizon."""
        shape = pair.shape_of(distribution)
        i, o = pair.seen(distribution, wi), pair.seen(distribution, wo)
        first, second, third, rest, fall = self.network(features(shape, i, o))
        cos = wo.z / math.pi
        one, two, three, others = (torch.exp(x.clamp(*EXPONENT)) for x in (first, second, third, rest))
        values = smith(distribution, i, o) * one, two, three, others
        # λ stays below 1, where no light would ever be lost.
        return [value * cos for value in values], torch.sigmoid(fall.clamp(-12.0, 4.0))

    def evaluate(self, vertex: Diffuse, wi: Vec3, wo: Vec3) -> list[Tensor]:
        """f · cos θ_o [1/sr] of the orders 1, 2, 3 and of all others together, each (C, 1, …)."""
        valid = (wi.z > 0) & (wo.z > 0)
        lobes, fall = self.white(self.distribution_of(vertex), pair.above(wi), pair.above(wo))
        albedo = channels_first(vertex.albedo, wi.z.ndim)
        return [
            torch.where(valid, factor * lobe, 0.0) for factor, lobe in zip(powers(albedo, fall), lobes, strict=True)
        ]

    def walk(self, vertex: Diffuse, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        """One direction of a cosine lobe, along which the orders leave with the shares that they have there."""
        d = cosine_hemisphere(u[1], u[2])
        lobes, fall = self.white(self.distribution_of(vertex), pair.above(wi), pair.above(d))
        total = sum(lobes[1:], lobes[0])
        weight = torch.where(wi.z > 0, total * math.pi / pair.above(d).z, 0.0)
        albedo = channels_first(vertex.albedo, wi.z.ndim)
        stays = torch.zeros_like(d.z, dtype=torch.bool)
        for factor, lobe in zip(powers(albedo, fall), lobes, strict=True):
            yield Exit(d, factor * weight, lobe / total, stays)


def powers(albedo: Tensor, fall: Tensor) -> list[Tensor]:
    """What each order is multiplied by for an albedo below 1."""
    square = albedo * albedo
    return [albedo, square, square * albedo, square * square * (1 - fall) / (1 - fall * albedo)]
