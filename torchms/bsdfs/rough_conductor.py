"""Rough metal."""

from torchms.bsdfs.base import BSDF
from torchms.bsdfs.usual import usual
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators.base import Scattering
from torchms.fresnel.base import Fresnel
from torchms.paths.mirror import Mirror
from torchms.sampling.proposals import Proposal, ReflectionProposal


class RoughConductor(BSDF):
    """Mirror facets with any Fresnel term; reflects above the horizon only.

    scattering: if it is not given, `Distilled()` where that applies when the surface is built (GGX or Beckmann, roughness in
    [0.03, 1]), which needs no random numbers, and `Unidirectional(Invariance(), max_order=8)` elsewhere.
    """

    sources = ("Heitz2014",)

    def __init__(
        self, distribution: MicrofacetDistribution, fresnel: Fresnel, scattering: Scattering | None = None
    ) -> None:
        super().__init__()
        if not isinstance(fresnel, Fresnel):
            raise TypeError(
                "RoughConductor(fresnel=...) must be a torchms.fresnel module such as Conductor.metal('Cu'), or "
                f"Schlick([0.95, 0.8, 0.3]) for a colour seen straight on; got {fresnel!r}."
            )
        self.fresnel = fresnel
        self._assemble(distribution, usual(Mirror(distribution, fresnel)) if scattering is None else scattering)

    @property
    def is_lossless(self) -> bool:
        return self.fresnel.is_lossless

    @property
    def vertex(self) -> Mirror:
        return Mirror(self.distribution, self.fresnel)

    @property
    def proposal(self) -> Proposal:
        return self.scattering.proposal(self.vertex) or ReflectionProposal(self.distribution)

    @property
    def n_channels(self) -> int:
        return self.fresnel.n_channels
