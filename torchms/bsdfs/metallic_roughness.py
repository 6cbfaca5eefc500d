"""glTF 2.0's material, with all bounces."""

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from torchms.approximations.layered import DiffuseBase, Whitened
from torchms.approximations.layered_sampling import LayeredProposal
from torchms.approximations.metal_features import above
from torchms.bsdfs.base import BSDF
from torchms.distributions.ggx import GGX
from torchms.estimators.base import Exit
from torchms.estimators.single_bounce import SingleBounce
from torchms.fresnel.schlick import Schlick
from torchms.maths.frame import Vec3, dot, half_vector
from torchms.maths.numerics import horizon
from torchms.parameters.declared import Value, channels_first, describe
from torchms.parameters.exchange import with_parameters
from torchms.parameters.maps import agreeing
from torchms.paths.mirror import Mirror
from torchms.sampling.proposals import ReflectionProposal
from torchms.sampling.warps import cosine_hemisphere

DIFFUSE = ("lambert", "rough")
BOUNCES = ("all", "one")
LEAST_ALPHA = GGX.limits[0]

# What is copied with the numbers of a surface in it.
_ROUND, _STRETCHED, _FACET = GGX(0.5), GGX(0.5, 0.5), Schlick(0.5)


class MetallicRoughness(BSDF):
    """glTF 2.0's material: a metal, or a base below a rough dielectric, or any mix of both; all bounces, without noise.

    base_color: (C,) or per pixel (*batch, C), linear, in [0, 1]. metallic, roughness: numbers or maps (*batch) in [0, 1].
    ior: of the dielectric, in [1, 3]. anisotropy: in [0, 1], as KHR_materials_anisotropy; x of the frame is the tangent.
    Maps may have an axis of one more at the end, (H, W, 1) beside a base colour (H, W, C).

    Facets are GGX with α_y = max(roughness², 1e-3), α_x = lerp(α_y, 1, anisotropy²), and reflect by Schlick's curve up from
    F0 = lerp(((ior − 1) / (ior + 1))², base_color, metallic). What the facets do not return, the share
    (1 − metallic)(1 − F0 of the dielectric) / (1 − F0) of it reaches the base; the metal absorbs the rest. The base returns
    light in proportion to what gets through either way, with the base colour: see `torchms.approximations.layered`.
    Reciprocal; white for a white base colour, whatever metallic is.
    diffuse: "lambert", or "rough" for diffuse facets of the same roughness. bounces: "all", or "one" for what glTF's
    Appendix B writes, one bounce with the base lerp(base_color, 0, metallic) (1 − F) / π, for comparison: it loses energy
    where it is rough and gains some at grazing angles where it is smooth.
    The orders are those of `Distilled`, and last what the base returns; with one bounce these two.
    Raises TypeError or ValueError for numbers out of range, another word, or maps that do not belong together.
    """

    sources = ("KullaConty2017", "Wang2022", "Cui2023")

    base_color: Tensor
    metallic: Tensor
    roughness: Tensor
    ior: Tensor
    anisotropy: Tensor | None

    def __init__(
        self,
        base_color: Value,
        metallic: float | Tensor,
        roughness: float | Tensor,
        *,
        ior: float | Tensor = 1.5,
        anisotropy: float | Tensor = 0,
        diffuse: str = "lambert",
        bounces: str = "all",
    ) -> None:
        super().__init__()
        for name, word, known in (("diffuse", diffuse, DIFFUSE), ("bounces", bounces, BOUNCES)):
            if word not in known:
                raise ValueError(f"MetallicRoughness({name}=...) must be one of {', '.join(known)}; got {word!r}.")
        maps = {"metallic": metallic, "roughness": roughness, "ior": ior, "anisotropy": anisotropy}
        maps = agreeing("base_color", base_color, maps)
        share = "Rescale or clamp the map."
        self.declare(
            "base_color",
            base_color,
            low=0.0,
            high=1.0,
            channels=True,
            remedy="It is linear, a share of light: divide 8-bit values by 255 and undo the curve of sRGB.",
        )
        self.declare("metallic", maps["metallic"], low=0.0, high=1.0, remedy=share)
        self.declare("roughness", maps["roughness"], low=0.0, high=1.0, remedy=share)
        self.declare("ior", maps["ior"], low=1.0, high=3.0, remedy="It is that of the dielectric outside of the base.")
        round_ = not isinstance(anisotropy, Tensor) and anisotropy == 0
        bent = None if round_ else maps["anisotropy"]
        self.declare("anisotropy", bent, low=0.0, high=1.0, remedy=share, optional=True)
        self.bounces = bounces
        self.scattering = Whitened() if bounces == "all" else SingleBounce()
        self.base = DiffuseBase(diffuse == "rough")

    # What the numbers of this moment mean.

    @property
    def distribution(self) -> GGX:  # type: ignore[override]
        """The facets."""
        alpha = self.roughness * self.roughness
        along = alpha.clamp_min(LEAST_ALPHA)
        if self.anisotropy is None:
            return with_parameters(_ROUND, {"alpha": along})
        wide = (alpha + (1 - alpha) * self.anisotropy * self.anisotropy).clamp_min(LEAST_ALPHA)
        return with_parameters(_STRETCHED, {"alpha": wide, "alpha_y": along})

    @property
    def dielectric_f0(self) -> Tensor:
        """Reflectance of the dielectric at normal incidence, (*batch)."""
        r = (self.ior - 1) / (self.ior + 1)
        return r * r

    @property
    def f0(self) -> Tensor:
        """Reflectance of the facets at normal incidence, (*batch, C)."""
        low = self.dielectric_f0.unsqueeze(-1)
        return low + (self.base_color - low) * self.metallic.unsqueeze(-1)

    @property
    def reach(self) -> Tensor:
        """(1 − metallic)(1 − F0 of the dielectric): the share of 1 − F0 that reaches the base, times that, (*batch)."""
        return (1 - self.metallic) * (1 - self.dielectric_f0)

    @property
    def vertex(self) -> Mirror:
        return Mirror(self.distribution, with_parameters(_FACET, {"f0": self.f0}))

    @property
    def proposal(self) -> LayeredProposal:
        facets = self.scattering.proposal(self.vertex) or ReflectionProposal(self.distribution)
        return LayeredProposal(facets, self.f0.mean(-1), self.reach * self.base_color.mean(-1))

    @property
    def n_channels(self) -> int:
        return self.base_color.shape[-1]

    @property
    def max_order(self) -> int:
        return self.scattering.max_order + 1

    @property
    def n_uniforms(self) -> int:
        return max(self.scattering.n_uniforms(self.vertex) + 2, self.proposal.n_uniforms)

    @property
    def is_lossless(self) -> bool:
        return self.bounces == "all" and bool((self.base_color == 1).all())

    # The sum of both.

    def _evaluate(self, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        return [*super()._evaluate(wi, wo, u), self._base_value(wi, wo)]

    def _base_value(self, wi: Vec3, wo: Vec3) -> Tensor:
        """f · cos θ_o of the base [1/sr], (C, 1, …)."""
        valid = (wi.z > 0) & (wo.z > 0)
        wi, wo = above(wi), above(wo)
        color, reach = self._color(wi), self.reach
        if isinstance(self.scattering, Whitened):
            layers = self.scattering.layers(self.distribution, wi, wo, self.base.rough)
            f0 = channels_first(self.f0, wi.z.ndim)
            value = reach * self.base.covered(layers, self.distribution, f0, color, wi, wo)
        else:
            # glTF 2.0, Appendix B: what one facet, that of the half vector, does not reflect.
            x = 1 - dot(wi, half_vector(wi, wo))
            value = reach * (1 - x * x * x * x * x) * self.base.returned(self.distribution, color, wi, wo, first=True)
        return torch.where(valid, value, 0.0)

    def _walk(self, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        share = self.proposal.base_share(wi)
        for leg in super()._walk(wi, u):
            yield leg._replace(weight=leg.weight / (1 - share), escapes=leg.escapes * (1 - share))
        first = self.scattering.n_uniforms(self.vertex)
        d = cosine_hemisphere(u[first], u[first + 1])
        d = Vec3(d.x, d.y, d.z.clamp_min(horizon(d.z.dtype)))
        # Where there is no base the share is 0, and so is what it returns.
        weight = self._base_value(wi, d) * (math.pi / d.z) / torch.where(share > 0, share, 1.0)
        yield Exit(d, weight, share.expand_as(d.z), torch.zeros_like(d.z, dtype=torch.bool))

    @property
    def knows_energies(self) -> bool:  # type: ignore[override]
        """Whether they are in the table: of Lambert's base below a round layer, with all bounces."""
        return isinstance(self.scattering, Whitened) and not self.base.rough and self.anisotropy is None

    def _energies(self, wi: Vec3) -> list[Tensor]:
        assert isinstance(self.scattering, Whitened)
        up, wi = wi.z > 0, above(wi)
        alpha, f0 = self.distribution.alpha, channels_first(self.f0, wi.z.ndim)
        base = self.base.reflected(self.scattering.table.layer(alpha, False), f0, self._color(wi), wi)
        orders = [*self.scattering.table.energies(alpha, wi, f0), self.reach * base]
        return [torch.where(up, energy, 0.0) for energy in orders]

    def _color(self, w: Vec3) -> Tensor:
        return channels_first(self.base_color, w.z.ndim)

    def extra_repr(self) -> str:
        return describe(self)
