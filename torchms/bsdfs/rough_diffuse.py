"""Rough matte surfaces."""

from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.bsdfs.usual import usual
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators.base import Scattering
from torchms.parameters.declared import describe
from torchms.paths.diffuse import Diffuse
from torchms.sampling.proposals import HemisphereProposal


class RoughDiffuse(BSDF):
    """Lambertian facets with an `albedo` in [0, 1] per channel: a float, (C,) or per pixel (*batch C).

    scattering: if it is not given, `Distilled()` where that applies when the surface is built (GGX or Beckmann, roughness in
    [0.03, 1]), which needs no random numbers, and `Unidirectional(Invariance(), max_order=8)` elsewhere. All models but
    `Distilled` estimate the first order, too: the facet is drawn. Raises ValueError if the albedo is outside its range.
    """

    sources = ("Heitz2014", "HeitzDupuy2015")

    reflectance: Tensor
    """The albedo of a facet, (*batch C); `albedo` is what the whole surface reflects."""

    def __init__(
        self,
        distribution: MicrofacetDistribution,
        albedo: float | list[float] | tuple[float, ...] | Tensor,
        scattering: Scattering | None = None,
    ) -> None:
        super().__init__()
        remedy = "A facet cannot reflect more than it receives."
        self.declare("reflectance", albedo, low=0.0, high=1.0, channels=True, remedy=remedy, argument="albedo")
        self._assemble(
            distribution, usual(Diffuse(distribution, self.reflectance)) if scattering is None else scattering
        )

    @property
    def is_lossless(self) -> bool:
        return bool((self.reflectance == 1).all())

    @property
    def vertex(self) -> Diffuse:
        return Diffuse(self.distribution, self.reflectance)

    @property
    def proposal(self) -> HemisphereProposal:
        return HemisphereProposal(self.distribution)

    @property
    def n_channels(self) -> int:
        return self.reflectance.shape[-1]

    def extra_repr(self) -> str:
        return describe(self)
