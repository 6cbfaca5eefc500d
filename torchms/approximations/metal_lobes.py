"""All further bounces between mirror facets as smooth functions of both directions: no random numbers, no noise.

With F = 1 everything after the first bounce leaves with g(wi, wo) = g(wo, wi), of which the orders 2, 3 and ≥ 4 have shares
that sum to 1. g is a function of the pair times s(wi) s(wo), which carries the energy that either direction asks for. Each
order meets facets at one effective cosine c_k, so with Fresnel it is F(c_k)^k of that, which is exact to first order in the
variation of F. The orders from 4 on fall off by a factor r each:

    Σ_{k ≥ 4} (1 − r) r^{k−4} F^k = F⁴ (1 − r) / (1 − r F).
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.approximations.distilled_file import Distillate
from torchms.approximations.metal_features import above, features, features_of_one
from torchms.approximations.network import Network, soft_sign
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel.base import Fresnel
from torchms.maths.frame import Vec3

OUTPUTS = 7
MOST_FALL = 0.95
"""Largest ratio of one order to the one before it."""
EXPONENT = (-14.0, 12.0)
"""Range of ln g: no network that was trained leaves it, and none overflows."""


class Rest(NamedTuple):
    """f [1/sr], without cos θ_o, of the orders 2, 3 and ≥ 4 with F = 1; their facet cosines; the ratio r of the last."""

    lobes: list[Tensor]
    cosines: list[Tensor]
    fall: Tensor


class MetalLobes(nn.Module):
    """Lobes of rough metals of one kind of distribution, from two networks: of the pair, and of each direction."""

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.each is not None
        self.network = Network(distillate.layers, distillate.skip)
        self.each = Network(*distillate.each)

    def rest(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Rest:
        """Kernel; both directions above the horizon."""
        level, second, third, *cosines, fall = self.network(features(distribution, wi, wo))
        both = Vec3(*(torch.stack(torch.broadcast_tensors(a, b)) for a, b in zip(wi, wo, strict=True)))
        one, other = self.each(features_of_one(distribution, both))[0]
        level = level + (one + other)
        g = torch.exp(level.clamp(*EXPONENT))
        a, b = torch.exp(second.clamp(-9.0, 9.0)), torch.exp(third.clamp(-9.0, 9.0))
        last = g / (1 + a + b)
        return Rest(
            [last * a, last * b, last],
            [0.5 + 0.5 * soft_sign(c) for c in cosines],
            (0.5 * MOST_FALL) * (1 + soft_sign(fall)),
        )

    def orders(self, distribution: EllipticDistribution, fresnel: Fresnel, wi: Vec3, wo: Vec3) -> list[Tensor]:
        """Kernel: f · cos θ_o [1/sr] of the orders 2, 3 and ≥ 4, each (C, …); 0 where a direction is not above."""
        valid = (wi.z > 0) & (wo.z > 0)
        wi, wo = above(wi), above(wo)
        rest = self.rest(distribution, wi, wo)
        lobes = [torch.where(valid, lobe * wo.z, 0.0) for lobe in rest.lobes]
        F2, F3, F4 = (fresnel.reflectance(c) for c in rest.cosines)
        square = F4 * F4
        tail = square * square * ((1 - rest.fall) / (1 - rest.fall * F4))
        return [F2 * F2 * lobes[0], F3 * F3 * F3 * lobes[1], tail * lobes[2]]
