"""Rough glass."""

import torch
from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators.base import Scattering
from torchms.estimators.height_walk import HeightWalk
from torchms.fresnel.interface import Interface
from torchms.maths.frame import Vec3
from torchms.maths.numerics import has_values
from torchms.parameters.declared import first_bad
from torchms.paths.refractive import Refractive
from torchms.sampling.proposals import DielectricProposal

MODES = ("radiance", "importance")


class RoughDielectric(BSDF):
    """Facets that reflect and refract; lit and seen from either side, `Dielectric(eta)` with n_inside / n_outside.

    fresnel: `Dielectric(eta)`, or an `Interface` of your own, which may have a reflectance a channel (a thin film).

    scattering: `HeightWalk(max_order=8)` if it is not given; `Invariance` is refused, it knows one side only.
    mode: "radiance" divides a value whose wo is on the other side than wi by the square of the relative index
    (n on wo's side / n on wi's side); "importance" does not. Energies (`albedo`, `lobes`) never carry that factor.
    Raises ValueError for another mode, for an eta of 1 (no interface), or for a scattering that cannot cross a surface.
    """

    sources = ("Heitz2014", "Walter2007")

    def __init__(
        self,
        distribution: MicrofacetDistribution,
        fresnel: Interface,
        scattering: Scattering | None = None,
        mode: str = "radiance",
    ) -> None:
        super().__init__()
        if not isinstance(fresnel, Interface):
            raise TypeError(
                "RoughDielectric(fresnel=...) must be a torchms.fresnel.Interface that light passes, such as Dielectric(1.5); "
                f"got {fresnel!r}."
            )
        if mode not in MODES:
            raise ValueError(f"RoughDielectric(mode=...) must be one of {', '.join(MODES)}; got {mode!r}.")
        matched = (fresnel.eta.detach() - 1).abs() < 1e-4
        if has_values(matched) and bool(matched.any()):
            raise ValueError(
                f"RoughDielectric(fresnel={type(fresnel).__name__}(eta=...)): eta must differ from 1 by 1e-4 at least; "
                f"got {first_bad(matched, fresnel.eta)}. With eta = 1 there is no interface."
            )
        self.fresnel = fresnel
        self.mode = mode
        self._assemble(distribution, HeightWalk() if scattering is None else scattering)

    @property
    def is_lossless(self) -> bool:
        return True

    @property
    def vertex(self) -> Refractive:
        return Refractive(self.distribution, self.fresnel)

    @property
    def proposal(self) -> DielectricProposal:
        return DielectricProposal(self.vertex)

    @property
    def n_channels(self) -> int:
        return self.fresnel.n_channels

    def _unit_of(self, wi: Vec3, wo: Vec3) -> Tensor | None:
        if self.mode == "importance":
            return None
        eta = torch.where(wi.z > 0, self.fresnel.eta, 1 / self.fresnel.eta)
        return torch.where((wi.z > 0) == (wo.z > 0), 1.0, 1 / (eta * eta))

    def extra_repr(self) -> str:
        return f"mode={self.mode!r}"
