"""Lobes of a real surface of glass: Smith's, reflected and transmitted, times what they are off by on ray-traced ones."""

import torch
from torch import Tensor

from torchms.approximations import free_glass_features as free
from torchms.approximations.distilled_file import Distillate, Weights
from torchms.approximations.glass_features import SYMMETRIC, Features, Pair, inputs, pair_of
from torchms.approximations.glass_lobes import GlassLobes
from torchms.approximations.surface_correction import SurfaceCorrection, facets_of
from torchms.maths.frame import Vec3
from torchms.paths.refractive import Refractive

SHARES = (0.8, 0.15, 0.05)
"""What two, three and more bounces have of Smith's rest before they are corrected: its network does not tell them apart."""


class GlassSurfaceLobes(GlassLobes):
    """See `SurfaceLobes`: a correction of each order of what is reflected and one of what is transmitted.

    What is reflected is corrected by numbers that exchanging both directions leaves alone, what is transmitted by numbers of
    the direction in the thinner and that in the denser medium: reciprocal, with the squares of the indices.
    """

    def __init__(self, distillate: Distillate) -> None:
        assert distillate.smith is not None and distillate.through is not None
        (a, a_each), (b, b_each) = distillate.smith[:2], distillate.smith[2:]
        super().__init__(_with(distillate, a, a_each), _with(distillate, b, b_each))
        self.of_reflected = SurfaceCorrection(distillate)
        self.of_transmitted = SurfaceCorrection(_with(distillate, *distillate.through))
        self.facets = facets_of(distillate)

    @property
    def features(self) -> Features:
        """Of the corrections."""
        return SYMMETRIC if self.facets is None else free.FREE

    def facets_of(self, vertex: Refractive) -> Refractive:
        return vertex if self.facets is None else Refractive(self.facets, vertex.fresnel)

    def beyond_first(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> tuple[Tensor | None, list[Tensor]]:
        """The factor of one bounce, and f · |cos θ_o| [1/sr] of two, three and more."""
        found = pair_of(self.facets_of(vertex), wi, wo)
        smiths = inputs(found)
        rest = self.rest_of(found, *smiths)
        first, *factors = self._factors(found, smiths if self.facets is None else inputs(found, self.features))
        return first, [share * rest * factor for share, factor in zip(SHARES, factors, strict=True)]

    def once(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor | None:
        found = pair_of(self.facets_of(vertex), wi, wo)
        return self._factors(found, inputs(found, self.features))[0]

    def _factors(self, found: Pair, features: tuple[list[Tensor], list[Tensor], list[Tensor]]) -> list[Tensor]:
        """Corrections of the orders, each of the side on which light leaves."""
        reflected, transmitted, of_both = features
        r, _ = self.of_reflected.factors(reflected, of_both)
        t, _ = self.of_transmitted.factors(transmitted, of_both)
        return [torch.where(found.crosses, b, a) for a, b in zip(r, t, strict=True)]


def _with(distillate: Distillate, pair: Weights, each: Weights) -> Distillate:
    """The same with these networks."""
    return distillate._replace(layers=pair[0], skip=pair[1], each=each)


def of_glass_smith(reflected: Distillate, transmitted: Distillate) -> tuple[Weights, ...]:
    """What `GlassSurfaceLobes` starts from, of the files of Smith's lobes of glass."""
    assert reflected.each is not None and transmitted.each is not None
    return (
        *((reflected.layers, reflected.skip), reflected.each),
        *((transmitted.layers, transmitted.skip), transmitted.each),
    )
