"""All further bounces between mirror facets as smooth functions of both directions: no random numbers, no noise.

With F = 1 everything after the first bounce leaves with g(wi, wo) = g(wo, wi), of which the orders 2, 3 and ≥ 4 have shares
that sum to 1. g is a function of the pair times s(wi) s(wo), which carries the energy that either direction asks for. What
is left of an order with another Fresnel term follows from means over the facets that it meets: see `facet_reflectance`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.approximations.distilled_file import Distillate
from torchms.approximations.facet_reflectance import MEANS, Met, mean_reflectances, met, reflected
from torchms.approximations.metal_features import above, features, features_of_one
from torchms.approximations.network import Network, soft_sign
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel.base import Fresnel
from torchms.fresnel.ideal import Ideal
from torchms.maths.frame import Vec3, stacked

OUTPUTS = 4
"""ln g; logarithms of the shares of the orders 2 and 3 over that of the others; r."""
FACETS = 3 * MEANS
"""Outputs of the network of the facets."""
MOST_FALL = 0.95
"""Largest ratio of one order to the one before it."""
EXPONENT = (-14.0, 12.0)
"""Range of ln g: no network that was trained leaves it, and none overflows."""


class Rest(NamedTuple):
    """f [1/sr], without cos θ_o, of the orders 2, 3 and ≥ 4 with F = 1; the ratio r of the last."""

    lobes: list[Tensor]
    fall: Tensor


def heads(outputs: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Ratios of the shares of the orders 2 and 3 to that of the others, and r, from all outputs but ln g."""
    second, third, fall = outputs
    return *ratios(second, third), fall_of(fall)


def ratios(second: Tensor, third: Tensor) -> tuple[Tensor, Tensor]:
    """Of the shares of the orders 2 and 3 to that of the others, from what a network says."""
    return torch.exp(second.clamp(-9.0, 9.0)), torch.exp(third.clamp(-9.0, 9.0))


def fall_of(output: Tensor) -> Tensor:
    """The ratio of one order from four on to the one before it, from what a network says."""
    return (0.5 * MOST_FALL) * (1 + soft_sign(output))


class MetalLobes(nn.Module):
    """Lobes of rough metals of one kind of distribution, from three networks: of the pair, of each direction, and of
    the facets that light meets, which only a Fresnel term asks for."""

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.each is not None and distillate.facets is not None
        self.network = Network(distillate.layers, distillate.skip)
        self.each = Network(*distillate.each)
        self.met = Network(*distillate.facets)

    def rest(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Rest:
        """Kernel; both directions above the horizon."""
        return self._rest(distribution, features(distribution, wi, wo), wi, wo)

    def facets(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> list[Met]:
        """Kernel: what the orders 2, 3 and ≥ 4 meet; both directions above the horizon."""
        return met(self.met(features(distribution, wi, wo)))

    def _rest(self, distribution: EllipticDistribution, of_pair: list[Tensor], wi: Vec3, wo: Vec3) -> Rest:
        level, *others = self.network(of_pair)
        one, other = self.each(features_of_one(distribution, stacked(wi, wo)))[0]
        g = torch.exp((level + (one + other)).clamp(*EXPONENT))
        a, b, fall = heads(others)
        last = g / (1 + a + b)
        return Rest([last * a, last * b, last], fall)

    def orders(self, distribution: EllipticDistribution, fresnel: Fresnel, wi: Vec3, wo: Vec3) -> list[Tensor]:
        """Kernel: f · cos θ_o [1/sr] of the orders 2, 3 and ≥ 4, each (C, …); 0 where a direction is not above."""
        valid = (wi.z > 0) & (wo.z > 0)
        wi, wo = above(wi), above(wo)
        of_pair = features(distribution, wi, wo)
        rest = self._rest(distribution, of_pair, wi, wo)
        lobes = [torch.where(valid, lobe * wo.z, 0.0) for lobe in rest.lobes]
        if isinstance(fresnel, Ideal):
            return [lobe[None] for lobe in lobes]
        facets = met(self.met(of_pair))
        left = reflected(*mean_reflectances(fresnel, facets), facets, rest.fall)
        return [share * lobe for share, lobe in zip(left, lobes, strict=True)]
