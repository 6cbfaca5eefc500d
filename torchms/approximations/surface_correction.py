"""What lobes of a real surface are over Smith's, of any material: exp(c_k(wi, wo) + e_k(wi) + e_k(wo)) of each order."""

import torch
from torch import Tensor, nn

from torchms.approximations.distilled_file import Distillate
from torchms.approximations.free_features import free_features, free_features_of_one
from torchms.approximations.metal_features import features, features_of_one
from torchms.approximations.network import Network
from torchms.approximations.pair_features import root_sign
from torchms.distributions.base import EllipticDistribution
from torchms.distributions.beckmann import Beckmann
from torchms.distributions.tabulated import Tabulated
from torchms.maths.frame import Vec3, stacked

ORDERS = 4
"""Orders with a correction of their own; the last is of four bounces and more."""
MOST = 8.0
"""Largest |ln| of a correction."""


class SurfaceCorrection(nn.Module):
    """Factors of the orders, from a network of the pair and one of each direction; unchanged if these are exchanged.

    A file about "gaussian" surfaces holds for any roughness in its range; one about a "scan" for that surface, of which
    nothing but reciprocity is known.
    """

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.each is not None
        self.network = Network(distillate.layers, distillate.skip, root_sign)
        self.each = Network(*distillate.each, root_sign)
        self.free = distillate.slopes is not None

    def inputs(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> tuple[list[Tensor], list[Tensor]]:
        """Kernel: features of the pair, and of both directions; both above the horizon."""
        of_pair, of_one = (free_features, free_features_of_one) if self.free else (features, features_of_one)
        return of_pair(distribution, wi, wo), of_one(distribution, stacked(wi, wo))

    def factors(self, of_pair: list[Tensor], of_both: list[Tensor]) -> tuple[list[Tensor], list[Tensor]]:
        """Kernel, from `inputs`: the factors of the orders 1, 2, 3 and ≥ 4, and what else the network says."""
        outputs = self.network(of_pair)
        each = [one + other for one, other in self.each(of_both)]
        factors = [torch.exp((c + e).clamp(-MOST, MOST)) for c, e in zip(outputs[:ORDERS], each, strict=True)]
        return factors, outputs[ORDERS:]


def as_beckmann(tabulated: Tabulated) -> Beckmann:
    """Beckmann with the same variances of slopes."""
    return Beckmann(*(float(alpha) for alpha in tabulated.alphas))


def facets_of(distillate: Distillate) -> Beckmann | None:
    """What Smith's lobes of a scan are those of; None for surfaces that the distribution says all of."""
    return None if distillate.slopes is None else as_beckmann(Tabulated(*distillate.slopes))
