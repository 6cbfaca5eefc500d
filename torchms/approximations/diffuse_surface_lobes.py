"""Lobes of a real surface with diffuse facets: Smith's of each order, times what they are off by on ray-traced ones."""

from torch import Tensor

from torchms.approximations.diffuse_lobes import DiffuseLobes
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.metal_lobes import fall_of
from torchms.approximations.surface_correction import ORDERS, SurfaceCorrection, facets_of
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3
from torchms.paths.diffuse import Diffuse

OUTPUTS = ORDERS + 1
"""Corrections, and the fall of the last order."""


class DiffuseSurfaceLobes(DiffuseLobes):
    """See `SurfaceLobes`; Smith's network is in the file, too, and on a scan it is asked for Beckmann of the same variances."""

    def __init__(self, distillate: Distillate) -> None:
        assert distillate.smith is not None
        ((layers, skip),) = distillate.smith
        super().__init__(distillate._replace(layers=layers, skip=skip))
        self.correction = SurfaceCorrection(distillate)
        self.facets = facets_of(distillate)

    def distribution_of(self, vertex: Diffuse) -> EllipticDistribution:
        return super().distribution_of(vertex) if self.facets is None else self.facets

    def white(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> tuple[list[Tensor], Tensor]:
        lobes, _ = super().white(distribution, wi, wo)
        factors, (fall,) = self.correction.factors(*self.correction.inputs(distribution, wi, wo))
        return [lobe * factor for lobe, factor in zip(lobes, factors, strict=True)], fall_of(fall)


def of_diffuse_smith(diffuse: Distillate) -> tuple[tuple[list[tuple[Tensor, Tensor]], Tensor]]:
    """What `DiffuseSurfaceLobes` starts from, of a file of Smith's lobes of diffuse facets."""
    return ((diffuse.layers, diffuse.skip),)
