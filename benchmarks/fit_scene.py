"""What `fit.py` looks at: a G-buffer of a mesh, lights, and materials whose α is a texture on the mesh."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.render import Camera
from torchms.render.mesh import Mesh
from torchms.render.paths import shading_point
from torchms.render.scenes import corner_normals
from torchms.render.shapes import Hits

TEXELS = (10, 12)
"""Rows and columns of the α texture over the visible half of the mesh."""


class GBuffer(NamedTuple):
    """The visible points: pixel (n,) number, wi (n, 3) to the camera in the local frame, uv (n, 2) in [−1, 1], and for
    every light wo (n, L, 3) in the local frame and whether it shines on the point (n, L)."""

    pixel: Tensor
    wi: Tensor
    uv: Tensor
    wo: Tensor
    lit: Tensor


def vase() -> Mesh:
    """A surface of revolution about y, about 2 units high, with smooth normals and tangents along its parallels."""
    y = -torch.cos(torch.linspace(0, math.pi, 121, dtype=torch.float64))[1:-1]
    radius = (1 - y * y).sqrt() * (0.8 - 0.16 * torch.sin(2.6 * y + 0.4))
    profile = torch.stack([radius, y], -1)
    ends = torch.tensor([[0.0, -1.0], [0.0, 1.0]], dtype=torch.float64)
    body = trimesh.creation.revolve(torch.cat([ends[:1], profile, ends[1:]]).numpy(), sections=192)
    vertices = body.vertices[:, [0, 2, 1]]
    faces = body.faces[:, ::-1]
    corners = vertices[faces]
    middle = corners.mean(1)
    edges = corners[:, 1:] - corners[:, :1]
    area = np.cross(edges[:, 0], edges[:, 1])
    if (area * middle).sum() < 0:
        faces, area = faces[:, ::-1], -area
    tangents = np.stack([middle[:, 2], 0 * middle[:, 0], -middle[:, 0]], -1)
    return Mesh(vertices, faces, corner_normals(faces, area, 30.0), tangents, is_closed=True)


def lights(inside: bool) -> Tensor:
    """Directions (L, 3) to the lights: eight around the camera and, `inside`, eight that face it, in the glass.

    Those are closer together: light that meets the surface from within at more than 42° from the normal is reflected.
    """
    k = torch.arange(8, dtype=torch.float64)
    phi = 2.4 * k
    rings = [0.35 + 0.12 * k, 0.1 + 0.07 * k] if inside else [0.35 + 0.12 * k]
    return torch.cat(
        [
            torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), sign * theta.cos()], -1)
            for theta, sign in zip(rings, (1, -1), strict=False)
        ]
    )


def g_buffer(size: int, inside: bool) -> GBuffer:
    """Primary hits of Embree at the pixels' centres, with a shadow ray to every light outside."""
    mesh, camera = vase(), Camera((0.0, 0.25, 4.2), fov=29.0)
    grid = (torch.arange(size, dtype=torch.float64) + 0.5) / size
    y, x = torch.meshgrid(grid, grid, indexing="ij")
    origin, direction = camera.rays(x.reshape(-1), y.reshape(-1), 1.0)
    hits = mesh.intersect(origin, direction)
    pixel = hits.found.nonzero()[:, 0]
    vertex = shading_point(Hits(*(part[pixel] for part in hits)), direction[pixel], False, torch.float32)
    towards = lights(inside)
    wo = torch.stack([vertex.to_local(light.expand(len(pixel), 3)) for light in towards], 1)
    lit = []
    for light, local in zip(towards, wo.unbind(1), strict=True):
        toward = light.expand(len(pixel), 3)
        start = mesh.offset(vertex.point, vertex.geometric, toward)
        within = (vertex.geometric * toward).sum(-1) < 0
        shines = torch.where(within, torch.tensor(inside), ~mesh.blocked(start, toward))
        # Shading normals may disagree with the mesh about the side.
        lit.append(shines & ((local[:, 2] < 0) == within) & (local[:, 2].abs() > 0.1))
    lit = torch.stack(lit, 1) & (vertex.wi[:, 2:] > 0.1)
    angle = torch.atan2(vertex.point[:, 0], vertex.point[:, 2]) / (math.pi / 2)
    uv = torch.stack([angle, vertex.point[:, 1]], -1).float()
    return GBuffer(pixel, vertex.wi, uv, wo.float(), lit)


def textured(texture: Tensor, uv: Tensor) -> Tensor:
    """The texture (R, C) at uv (n, 2), bilinearly: (n,)."""
    sampled = torch.nn.functional.grid_sample(texture[None, None], uv[None, None], "bilinear", "border", True)
    return sampled[0, 0, 0]


def alpha_map() -> Tensor:
    """The α texture that is to be found: bands and a slope, 0.18 to 0.62."""
    v = torch.linspace(0, 1, TEXELS[0])[:, None]
    u = torch.linspace(0, 1, TEXELS[1])[None]
    return 0.4 + 0.14 * torch.sin(9 * u + 4 * v) + 0.16 * (v - 0.5)


class Material(NamedTuple):
    """build: the surface for an α per row, the numbers of the Fresnel term and a scattering. truth: those numbers.

    module, name: what holds them as constrained parameters, and what they are called there. target, fitted: scatterings.
    """

    build: Callable[[Tensor, Tensor, ms.Scattering], ms.BSDF]
    truth: Tensor
    module: Callable[[], torch.nn.Module]
    name: str
    target: ms.Scattering
    fitted: ms.Scattering


def radiance(
    material: Material, alpha: Tensor, numbers: Tensor, scattering: ms.Scattering, wi: Tensor, wo: Tensor, u: ms.Stream
) -> Tensor:
    """(n, C) for light of unit irradiance; wi is towards the camera, so that the cosine is the light's.

    The first bounce is the closed form, which is that of every model; `scattering` gives the rest.
    """
    if isinstance(scattering, ms.Distilled):
        return ms.compile(material.build(alpha, numbers, scattering), verbose=False)(wi, wo)
    first = material.build(alpha, numbers, ms.SingleBounce())(wi, wo)
    if scattering.max_order == 1:
        return first
    return first + material.build(alpha, numbers, scattering).orders(wi, wo, u)[..., 1:, :].sum(-2)


def materials() -> dict[str, Material]:
    """Gold, whose fit uses another estimator than its target, and glass, where the height walk is the exact one."""
    gold = Conductor.metal("Au").forward(torch.ones(())).clamp(0, 0.98)
    return {
        "gold": Material(
            lambda alpha, f0, scattering: ms.RoughConductor(ms.GGX(alpha), Schlick(f0), scattering),
            gold,
            lambda: ms.constrain(Schlick([0.5, 0.5, 0.5]), "f0"),
            "f0",
            ms.HeightWalk(10),
            ms.Unidirectional(ms.Invariance(), 6),
        ),
        "glass": Material(
            lambda alpha, eta, scattering: ms.RoughDielectric(ms.GGX(alpha), Dielectric(eta), scattering),
            torch.tensor(1.5),
            lambda: ms.constrain(Dielectric(1.3), "eta", low=1.01, high=3.0),
            "eta",
            ms.HeightWalk(10),
            ms.HeightWalk(5),
        ),
    }


def f0_of(name: str, number: Tensor) -> Tensor:
    """Reflectance at normal incidence of the material called `name`."""
    return number if name == "gold" else ((number - 1) / (number + 1)) ** 2
