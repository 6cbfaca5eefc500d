"""PyPBR's `CookTorranceBRDF`, which takes PyPBR's materials, with the light that bounces again. PyPBR itself is not needed."""

from typing import Any

import torch
from torch import Tensor, nn

from torchms.bsdfs.metallic_roughness import MetallicRoughness
from torchms.dropins import formulas
from torchms.dropins.arguments import counts_all
from torchms.dropins.cosines import cosines
from torchms.dropins.ready import like_maps, ready
from torchms.maths.numerics import safe_sqrt
from torchms.render.images import srgb
from torchms.shading.world import shade

LIGHTS = ("directional", "point")
DIELECTRIC_F0, IOR = 0.04, 1.5
ADDEND = 1e-7
"""Added to distances."""


class CookTorranceBRDF(nn.Module):
    """What a material of PyPBR shows under one light, with all bounces; called like PyPBR's model of this name.

    light_type: "point" or "directional". override_device: where it is computed, that of the material if it is None.
    bounces: "all", a `MetallicRoughness` for materials with a metallic map; 1: PyPBR's own formula,
    `torchms.dropins.formulas.cook_torrance`. compiled: all bounces as machine code (`torchms.compile`).
    Raises ValueError for other words.
    """

    def __init__(
        self,
        light_type: str = "point",
        override_device: torch.device | None = None,
        *,
        bounces: str | int = "all",
        compiled: bool = False,
    ) -> None:
        super().__init__()
        self.every, self.compiled = counts_all("CookTorranceBRDF", bounces), compiled
        self.light_type = light_type.lower()
        if self.light_type not in LIGHTS:
            raise ValueError(
                f"CookTorranceBRDF(light_type=...) must be one of {', '.join(LIGHTS)}; got {light_type!r}."
            )
        self.override_device = override_device

    def forward(
        self,
        material: Any,
        view_dir: Tensor,
        light_dir_or_position: Tensor,
        light_intensity: Tensor,
        light_size: float | None = None,
        return_srgb: bool = True,
    ) -> Tensor:
        """The colour (3, H, W), clipped to [0, 1], in sRGB or linear.

        material: of PyPBR: albedo, roughness (here α itself), metallic or specular, and normal if there is one, as maps
        (C, H, W). view_dir (3,): towards the eye. light_dir_or_position (3,): towards the light, or where it is above the
        square of `light_size`, 1 if it is None, that the maps cover. light_intensity (3,).
        Raises ValueError for a material without metallic or specular, and for specular with all bounces.
        """
        device = self.override_device or material.device
        base = material.linear_albedo.to(device).movedim(0, -1)
        light, attenuation = self._light(light_dir_or_position.to(device), light_size or 1.0, base)
        normal = getattr(material, "normal", None)
        normal = base.new_tensor([0.0, 0.0, 1.0]) if normal is None else normal.to(device).movedim(0, -1)
        value = self._value(material, base, normal, view_dir.to(base), light)
        colour = (value * light_intensity.to(base).reshape(3) * attenuation).clamp(0.0, 1.0).movedim(-1, 0)
        return srgb(colour) if return_srgb else colour

    def _light(self, given: Tensor, size: float, base: Tensor) -> tuple[Tensor, Tensor]:
        """The way to the light (H, W, 3), or (3,), and what distance leaves of it."""
        given = given.to(base)
        if self.light_type == "directional":
            return given, torch.ones_like(given[:1])
        where = {"dtype": base.dtype, "device": base.device}
        x, y = (torch.linspace(-size / 2, size / 2, n, **where) for n in reversed(base.shape[:2]))
        point = torch.stack(torch.broadcast_tensors(x, -y[:, None], base.new_zeros(())), -1)
        way = given - point
        distance = way.norm(dim=-1, keepdim=True)
        return way / (distance + ADDEND), 1 / (distance * distance + ADDEND)

    def _value(self, material: Any, base: Tensor, normal: Tensor, view: Tensor, light: Tensor) -> Tensor:
        """f · cos θ_light [1/sr], (H, W, 3)."""
        alpha = material.roughness.to(base)[0]
        metallic, specular = (getattr(material, name, None) for name in ("metallic", "linear_specular"))
        if metallic is None and specular is None:
            raise ValueError("CookTorranceBRDF: the material must have a map called metallic or specular.")
        metallic = None if metallic is None else metallic.to(base)[0]
        if self.every:
            if metallic is None:
                raise ValueError(
                    "CookTorranceBRDF: all bounces are those of a material with a metallic map; this one has specular. "
                    "Convert it, material.to_basecolor_metallic_material(), or take bounces=1."
                )
            # Theirs is α, that of glTF its root.
            surface = MetallicRoughness(base, metallic, safe_sqrt(alpha), ior=like_maps(IOR, base))
            surface = ready(surface, base.device, self.compiled)
            return shade(surface, normal, view, light, normalize=True)
        if metallic is not None:
            f0 = torch.lerp(torch.full_like(base, DIELECTRIC_F0), base, metallic.unsqueeze(-1))
        else:
            assert specular is not None
            f0 = specular.to(base).movedim(0, -1)
        at = cosines(normal, view, light)
        return formulas.cook_torrance(at, alpha, base, f0, metallic)
