"""`GGX_specular` of relit radiance fields and Gaussians, with the light that bounces again."""

import torch
from torch import Tensor

from torchms.approximations.layered import Whitened
from torchms.bsdfs import RoughConductor
from torchms.distributions import GGX
from torchms.dropins import formulas
from torchms.dropins.arguments import as_map, check_map, counts_all
from torchms.dropins.cosines import cosines
from torchms.dropins.ready import ready
from torchms.fresnel import Schlick
from torchms.maths.frame import check_direction
from torchms.shading.roughness import alpha
from torchms.shading.world import shade

LEAST_ALPHA = GGX.limits[0]


def GGX_specular(
    normal: Tensor,
    pts2c: Tensor,
    pts2l: Tensor,
    roughness: Tensor | float,
    fresnel: Tensor | float,
    *,
    bounces: str | int = "all",
    compiled: bool = False,
) -> Tensor:
    """f of rough metal [1/sr], without the cosine, (*batch, L, C): points that are each seen once and lit from L directions.

    normal, pts2c (*batch, 3): the normal, which is turned to the camera, and the way to it. pts2l (*batch, L, 3): the ways
    to the lights. World space, any length; 0 where one is zero. roughness: (*batch, 1) or a number, α = roughness².
    fresnel: F0, (*batch, C), (C) or a number. Differentiable in all of them.
    bounces: "all", with which a white surface (F0 = 1) returns all light. 1: the formula of TensoIR, Relightable 3D Gaussians
    and IRGS, `torchms.dropins.formulas.schlick_masking`, which is positive below the horizon, too: the cosine is the caller's.
    compiled: all bounces as machine code (`torchms.compile`).
    Raises TypeError or ValueError for shapes that do not belong together; with all bounces for numbers outside of [0, 1].
    """
    every = counts_all("GGX_specular", bounces)
    for name, vector in {"normal": normal, "pts2c": pts2c, "pts2l": pts2l}.items():
        check_direction(vector, name)
    batch = pts2l.shape[:-2]
    for name, vector in {"normal": normal, "pts2c": pts2c}.items():
        if vector.shape[:-1] != batch or pts2l.ndim < 2:
            raise ValueError(
                f"GGX_specular: {name} must be (*batch, 3) and pts2l (*batch, L, 3) of the same batch; got "
                f"{tuple(vector.shape)} and {tuple(pts2l.shape)}. One light a point is pts2l[..., None, :]."
            )
    check_map("GGX_specular", "roughness", roughness, batch, 1)
    check_map("GGX_specular", "fresnel", fresnel, batch, None)
    r, f0 = (as_map(x, pts2l) for x in (roughness, fresnel))
    normal, view, f0 = normal.unsqueeze(-2), pts2c.unsqueeze(-2), f0.unsqueeze(-2)
    if not every:
        at = cosines(normal, view, pts2l, two_sided=True)
        return torch.where(at.there.unsqueeze(-1), formulas.schlick_masking(at, r, f0), 0.0)
    metal = RoughConductor(GGX(alpha(r, least=LEAST_ALPHA)), Schlick(f0), Whitened())
    metal = ready(metal, pts2l.device, compiled)
    return shade(metal, normal, view, pts2l, two_sided=True, cosine=False, normalize=True)
