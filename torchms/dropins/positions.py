"""`pbr_bsdf` of nvdiffrec and what grew from it, with the light that bounces again."""

import torch
from torch import Tensor

from torchms.bsdfs.metallic_roughness import MetallicRoughness
from torchms.dropins import formulas
from torchms.dropins.arguments import counts_all
from torchms.dropins.cosines import cosines
from torchms.dropins.ready import like_maps, ready
from torchms.maths.frame import check_direction
from torchms.shading.world import shade

DIELECTRIC_F0, IOR = 0.04, 1.5


def pbr_bsdf(
    kd: Tensor,
    arm: Tensor,
    pos: Tensor,
    nrm: Tensor,
    view_pos: Tensor,
    light_pos: Tensor,
    min_roughness: float = 0.08,
    bsdf: str = "lambert",
    *,
    bounces: str | int = "all",
    compiled: bool = False,
) -> Tensor:
    """f · cos θ_light [1/sr] of metallic-roughness maps, (B, H, W, 3), or of any batch.

    kd (B, H, W, 3): base colour. arm (B, H, W, 3): (·, roughness, metallic), α = max(roughness, min_roughness)². pos, nrm
    (B, H, W, 3): position and normal. view_pos, light_pos: where the camera and the light are, (B, 1, 1, 3) or whatever
    broadcasts. Normals of any length; 0 where a vector is zero. Differentiable in all tensors.
    bounces: "all", a `MetallicRoughness`: white for a white kd, whatever metallic is; `arm[..., 0]` is not looked at. 1: the
    formula of nvdiffrec, Lambert's kd (1 − metallic) / π beside `torchms.dropins.formulas.smith` with
    F0 = lerp(0.04, kd, metallic) (1 − arm[..., 0]), which adds the two without asking what the facets let through.
    compiled: all bounces as machine code (`torchms.compile`). bsdf: "lambert" is the only base.
    Raises TypeError or ValueError for shapes and words that do not fit; with all bounces for numbers outside of [0, 1].
    """
    every = counts_all("pbr_bsdf", bounces)
    if bsdf != "lambert":
        raise ValueError(
            f'pbr_bsdf(bsdf=...) must be "lambert"; got {bsdf!r}. For a rough base take '
            'torchms.MetallicRoughness(..., diffuse="rough").'
        )
    if not 0 <= min_roughness <= 1:
        raise ValueError(f"pbr_bsdf(min_roughness=...) must lie in [0, 1]; got {min_roughness}.")
    given = {"kd": kd, "arm": arm, "pos": pos, "nrm": nrm, "view_pos": view_pos, "light_pos": light_pos}
    for name, x in given.items():
        check_direction(x, name)
    view, light = view_pos - pos, light_pos - pos
    taken, roughness, metallic = arm.unbind(-1)
    if every:
        material = MetallicRoughness(kd, metallic, roughness.clamp(min_roughness, 1.0), ior=like_maps(IOR, kd))
        material = ready(material, kd.device, compiled)
        return shade(material, nrm, view, light, normalize=True)
    at = cosines(nrm, view, light)
    share = metallic.unsqueeze(-1)
    f0 = (DIELECTRIC_F0 * (1 - share) + kd * share) * (1 - taken.unsqueeze(-1))
    alpha = (roughness * roughness).clamp(min_roughness * min_roughness, 1.0)
    lambert = kd * (1 - share) * (at.light.clamp_min(0) / torch.pi).unsqueeze(-1)
    return torch.where(at.there.unsqueeze(-1), lambert + formulas.smith(at, alpha, f0), 0.0)
