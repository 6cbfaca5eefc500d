"""Lobes of a real surface: Smith's, times what they are off by on ray-traced ones.

    f_k = (Smith's f_k) · exp(c_k(wi, wo) + e_k(wi) + e_k(wo)),   k = 1, 2, 3, ≥ 4,

with c_k unchanged if wi and wo are exchanged: reciprocal and positive whatever was learned. Smith's theory takes the
heights and slopes of facets that light meets one after the other as independent; c_k holds what that misses.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.approximations.distilled_file import Distillate
from torchms.approximations.free_features import free_features, free_features_of_one
from torchms.approximations.metal_features import above, features, features_of_one
from torchms.approximations.metal_lobes import MOST_FALL, MetalLobes, Rest, lit
from torchms.approximations.network import Network, soft_sign
from torchms.approximations.pair_features import root_sign
from torchms.distributions.base import EllipticDistribution
from torchms.distributions.beckmann import Beckmann
from torchms.fresnel.base import Fresnel
from torchms.maths.frame import Vec3

ORDERS = 4
"""Orders with a correction of their own; the last is of four bounces and more."""
OUTPUTS = ORDERS + 4
"""Corrections, facet cosines of the orders 2, 3 and ≥ 4, and the fall of the last."""
MOST = 8.0
"""Largest |ln| of a correction."""


class Corrected(NamedTuple):
    """The factor of one bounce [1], and the rest."""

    first: Tensor
    rest: Rest


class SurfaceLobes(nn.Module):
    """Lobes of explicit surfaces of metal, from Smith's and two networks: of the pair, and of each direction.

    smith: those of Beckmann from the second bounce on. A file about "gaussian" surfaces holds for any roughness in its range;
    one about a "scan" for that surface, whose further bounces start from those of Beckmann with its variances of slopes.
    """

    def __init__(self, smith: MetalLobes, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.each is not None
        self.smith = smith
        self.network = Network(distillate.layers, distillate.skip, root_sign)
        self.each = Network(*distillate.each, root_sign)
        self.facets = None if distillate.slopes is None else Beckmann(*distillate.slopes.alphas)
        """What further bounces, and directions to sample, start from on a scan; elsewhere the facets of the surface."""

    def corrected(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Corrected:
        """Kernel; both directions above the horizon."""
        of_pair, of_one = (features, features_of_one) if self.facets is None else (free_features, free_features_of_one)
        found = self.network(of_pair(distribution, wi, wo))
        both = Vec3(*(torch.stack(torch.broadcast_tensors(a, b)) for a, b in zip(wi, wo, strict=True)))
        each = [one + other for one, other in self.each(of_one(distribution, both))]
        first, *others = (torch.exp((c + e).clamp(-MOST, MOST)) for c, e in zip(found[:ORDERS], each, strict=True))
        *cosines, fall = found[ORDERS:]
        lobes = self.smith.rest(distribution, wi, wo).lobes
        rest = Rest(
            [lobe * factor for lobe, factor in zip(lobes, others, strict=True)],
            [0.5 + 0.5 * soft_sign(c) for c in cosines],
            (0.5 * MOST_FALL) * (1 + soft_sign(fall)),
        )
        return Corrected(first, rest)

    def rest(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Rest:
        """Kernel: all from the second bounce on, both directions above the horizon."""
        return self.corrected(distribution, wi, wo).rest

    def first(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> Tensor:
        """Kernel: the surface's single bounce over Smith's."""
        return self.corrected(distribution, wi, wo).first

    def orders(
        self, single: Tensor, distribution: EllipticDistribution, fresnel: Fresnel, wi: Vec3, wo: Vec3
    ) -> list[Tensor]:
        """Kernel: f · cos θ_o [1/sr] of the orders 1, 2, 3 and ≥ 4, each (C, …); `single` is Smith's of one bounce."""
        first, rest = self.corrected(distribution, above(wi), above(wo))
        return [single * first, *lit(rest, fresnel, wi, wo)]
