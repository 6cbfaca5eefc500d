"""Lobes of a real surface: Smith's, times what they are off by on ray-traced ones.

    f_k = (Smith's f_k) · exp(c_k(wi, wo) + e_k(wi) + e_k(wo)),   k = 1, 2, 3, ≥ 4,

with c_k unchanged if wi and wo are exchanged: reciprocal and positive whatever was learned. Smith's theory takes the
heights and slopes of facets that light meets one after the other as independent; c_k holds what that misses.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.approximations.distilled_file import Distillate
from torchms.approximations.metal_features import above, features, features_of_one
from torchms.approximations.metal_lobes import EXPONENT, fall_of, ratios
from torchms.approximations.network import Network, soft_sign
from torchms.approximations.surface_correction import ORDERS, SurfaceCorrection, facets_of
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel.base import Fresnel
from torchms.maths.frame import Vec3, stacked

OUTPUTS = ORDERS + 4
"""Corrections, facet cosines of the orders 2, 3 and ≥ 4, and the fall of the last."""
OF_SMITH = 3
"""Outputs of Smith's network: ln of all orders from the second on, and of the second and the third over the others."""


class Corrected(NamedTuple):
    """With F = 1: the factor of one bounce [1]; f [1/sr], without cos θ_o, of the orders 2, 3 and ≥ 4; their facets' cosines;
    the ratio of one order from four on to the one before it."""

    first: Tensor
    lobes: list[Tensor]
    cosines: list[Tensor]
    fall: Tensor


class SurfaceLobes(nn.Module):
    """Lobes of explicit surfaces of metal, from Smith's and two networks: of the pair, and of each direction.

    A file about "gaussian" surfaces holds for any roughness in its range; one about a "scan" for that surface, whose further
    bounces start from those of Beckmann with its variances of slopes. Smith's networks are in the file, too: what is
    corrected must stay what it was.
    """

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.smith is not None
        smith, smith_each = distillate.smith
        self.smith, self.smith_each = Network(*smith), Network(*smith_each)
        self.correction = SurfaceCorrection(distillate)
        self.facets = facets_of(distillate)
        """What further bounces, and directions to sample, start from on a scan; elsewhere the facets of the surface."""

    def rest(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Corrected:
        """Kernel; both directions above the horizon."""
        smiths = features(distribution, wi, wo), features_of_one(distribution, stacked(wi, wo))
        level, second, third = self.smith(smiths[0])
        one, other = self.smith_each(smiths[1])[0]
        a, b = ratios(second, third)
        last = torch.exp((level + (one + other)).clamp(*EXPONENT)) / (1 + a + b)
        found = self.correction.inputs(distribution, wi, wo) if self.correction.free else smiths
        (first, *factors), (*cosines, fall) = self.correction.factors(*found)
        return Corrected(
            first,
            [lobe * factor for lobe, factor in zip((last * a, last * b, last), factors, strict=True)],
            [0.5 + 0.5 * soft_sign(c) for c in cosines],
            fall_of(fall),
        )

    def orders(
        self, single: Tensor, distribution: EllipticDistribution, fresnel: Fresnel, wi: Vec3, wo: Vec3
    ) -> list[Tensor]:
        """Kernel: f · cos θ_o [1/sr] of the orders 1, 2, 3 and ≥ 4, each (C, …); `single` is Smith's of one bounce.

        Each order meets facets at one effective cosine c_k, so with Fresnel it is F(c_k)^k of what it is with F = 1, which is
        exact to first order in the variation of F.
        """
        valid = (wi.z > 0) & (wo.z > 0)
        found = self.rest(distribution, above(wi), above(wo))
        two, three, more = (torch.where(valid, lobe * wo.z, 0.0) for lobe in found.lobes)
        F2, F3, F4 = (fresnel.reflectance(c) for c in found.cosines)
        square = F4 * F4
        # Σ_{k ≥ 4} (1 − r) r^{k−4} F^k = F⁴ (1 − r) / (1 − r F).
        tail = square * square * ((1 - found.fall) / (1 - found.fall * F4))
        return [single * found.first, F2 * F2 * two, F3 * F3 * F3 * three, tail * more]


def of_smith(metal: Distillate) -> tuple[tuple[list, Tensor], tuple[list, Tensor]]:
    """What `SurfaceLobes` starts from, of a file of Smith's lobes of metal: networks of the pair and of each direction."""
    assert metal.each is not None
    *hidden, (weight, offset) = metal.layers
    return ([*hidden, (weight[:OF_SMITH], offset[:OF_SMITH])], metal.skip[:OF_SMITH]), metal.each
