"""The formulas of rough metal that rendering code uses, written from their equations: f · cos θ_light of view and light.

All take α = r² and Schlick's F = F0 + (1 − F0)(1 − c)⁵, so that they differ in what they say of masking, and of the lobe.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

import torchms as ms
from torchms.dropins import GGX_specular, formulas, pbr_bsdf
from torchms.dropins.cosines import Cosines, cosines

NORMAL = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
FAR = 1e6
"""Where the camera and the light are, along their directions."""

Formula = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
"""view, light (n, 3) in the local frame, roughness (n, 1), F0 (n, C): f · cos θ_light [1/sr], (n, C), float64."""


def above(at: Cosines, value: Tensor) -> Tensor:
    return torch.where(((at.light > 0) & (at.view > 0))[..., None], value, 0.0)


def density(at: Cosines, r: Tensor) -> Tensor:
    """D of GGX [1/sr]."""
    alpha2 = r[:, 0] ** 4
    return alpha2 / (math.pi * formulas.stretched(at.half, alpha2) ** 2)


def schlick_point(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """k = (r + 1)² / 8, Karis 2013 for points and what radiance fields took from there: the drop-in with one bounce."""
    return GGX_specular(NORMAL.expand_as(view), view, light[:, None], r, f0, bounces=1)[:, 0] * light[:, 2:].clamp_min(
        0
    )


def schlick_image(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """k = α / 2, Karis 2013 for images of light; Schlick 1994 has √(2/π) α for Beckmann's distribution."""
    at = cosines(NORMAL, view, light)
    k = r[:, 0] ** 2 / 2
    below = 4 * formulas.masked(at.view, k) * formulas.masked(at.light, k)
    F = formulas.raised(f0, formulas.schlick_weight(at.met))
    return above(at, F * (density(at, r) / below * at.light)[:, None])


def smith_correlated(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """[Heitz2014] Eq. 99, which is glTF's and Filament's; nvdiffrec's drop-in with one bounce, metallic = 1, kd = F0."""
    zero = torch.zeros_like(view)
    arm = torch.cat([torch.zeros_like(r), r, torch.ones_like(r)], -1)
    kd = f0.expand(-1, 3)
    value = pbr_bsdf(kd, arm, zero, NORMAL.expand_as(view), FAR * view, FAR * light, 0.0, bounces=1)
    return value[:, : f0.shape[-1]]


def view_masking(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """G = G1(view): facets that are seen are lit."""
    at = cosines(NORMAL, view, light)
    G1 = 2 / (1 + formulas.root(at.view, r[:, 0] ** 4))
    F = formulas.raised(f0, formulas.schlick_weight(at.met))
    return above(at, F * (density(at, r) * G1 / (4 * at.view))[:, None])


def spherical_gaussian(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """Wang et al. 2009, All-Frequency Rendering of Dynamic, Spatially-Varying Reflectance; as PhySG has it.

    D ≈ exp(λ (h · n − 1)) / (π α²), λ = 2 / α², becomes a lobe about the mirror direction with λ / (4 n · v); F and Schlick's
    G with k = (r + 1)² / 8 are those of that direction.
    """
    at = cosines(NORMAL, view, light)
    alpha2 = r[:, 0] ** 4
    mirror = view * torch.tensor([-1.0, -1.0, 1.0], dtype=view.dtype)
    lobe = torch.exp(2 / alpha2 / (4 * at.view) * ((mirror * light).sum(-1) - 1)) / (math.pi * alpha2)
    k = formulas.hotness(r[:, 0])
    F = formulas.raised(f0, formulas.schlick_weight(at.view))
    return above(at, F * (lobe / (4 * formulas.masked(at.view, k) ** 2) * at.light)[:, None])


def all_bounces(view: Tensor, light: Tensor, r: Tensor, f0: Tensor) -> Tensor:
    """What `torchms.dropins` puts in their place."""
    return GGX_specular(NORMAL.expand_as(view), view, light[:, None], r, f0)[:, 0] * light[:, 2:].clamp_min(0)


FORMULAS: dict[str, Formula] = {
    "Schlick G, k = (r + 1)²/8": schlick_point,
    "Schlick G, k = α/2": schlick_image,
    "Smith G, correlated": smith_correlated,
    "masking of the view": view_masking,
    "spherical Gaussian": spherical_gaussian,
    "all bounces": all_bounces,
}
USED_BY = {
    "Schlick G, k = (r + 1)²/8": "TensoIR, Relightable 3D Gaussians, IRGS, PyPBR",
    "Schlick G, k = α/2": "split-sum tables",
    "Smith G, correlated": "nvdiffrec, glTF viewers",
    "masking of the view": "the weak white furnace test",
    "spherical Gaussian": "PhySG and its descendants",
    "all bounces": "`GGX_specular`, `pbr_bsdf`",
}


def proposal(r: float) -> ms.RoughConductor:
    """A surface whose samples are close to the lobes of all formulas, or wider."""
    return ms.RoughConductor(ms.GGX(max(r * r, 0.03)), ms.fresnel.Ideal(), ms.Distilled()).double()
