"""Radiance along camera rays.

An opaque surface is lit directly: camera, surface, light. It is seen from both sides, and other parts of the mesh
shade it. A dielectric fills the closed body of the mesh. Its paths are: camera, outer side of the surface, light; and
camera, surface, 1 … `inner` segments inside the body with a scattering at the end of each, light. For a convex body
this is all the light, except for what is still inside after so many segments. A ray that has left the body
is not followed to another part of the mesh, which is a plain shadow caster there. There is no absorption inside.

The BSDF is called as `bsdf(wi, wo)` with wi towards the camera and wo towards the light: in the mode "radiance" of a
dielectric that is the radiance that the camera sees. A model that is not reciprocal is evaluated that way round, too.
"""

from typing import Literal, NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchms.bsdfs.base import BSDF
from torchms.maths.frame import Vec3, orthonormal_basis
from torchms.render.lights import Light
from torchms.render.shapes import Hits, Shape
from torchms.sampling.uniforms import draw

Sampling = Literal["mis", "light", "bsdf"]


class ShadingPoint(NamedTuple):
    """A point where a path is scattered: position, geometric normal and the axes of the local frame, each (n, 3).

    outside: (n,) whether the path arrives from the outer side. wi: (n, 3) local direction back along the path.
    """

    point: Tensor
    geometric: Tensor
    x: Tensor
    y: Tensor
    z: Tensor
    outside: Tensor
    wi: Tensor

    def to_local(self, v: Tensor) -> Tensor:
        """Components of `v` along the axes, in the dtype of wi."""
        return torch.stack([(v * axis).sum(-1) for axis in (self.x, self.y, self.z)], -1).to(self.wi.dtype)

    def to_world(self, v: Tensor) -> Tensor:
        """The inverse of `to_local`, in float64 and of unit length."""
        v = v.double()
        return normalize(v[:, :1] * self.x + v[:, 1:2] * self.y + v[:, 2:] * self.z, dim=-1)

    def rows(self, index: Tensor) -> "ShadingPoint":
        """Some of the rows."""
        return ShadingPoint(*(part[index] for part in self))


class Scene(NamedTuple):
    """Everything that a ray may need."""

    shape: Shape
    light: Light
    bsdf: BSDF
    sampling: Sampling = "mis"
    inner: int = 8
    background: bool = True

    @property
    def transmits(self) -> bool:
        """Whether the body is of glass."""
        return self.bsdf.vertex.transmits


def shading_point(hits: Hits, direction: Tensor, two_sided: bool, dtype: torch.dtype) -> ShadingPoint:
    """The local frames where rays along `direction` meet a surface: z the shading normal, x along the tangent.

    Where the shading normal faces away from the camera although the surface does not, at the rim of a faceted body,
    the geometric normal is taken. `two_sided`: both normals are turned to the camera.
    """
    outside = (direction * hits.geometric).sum(-1) < 0
    geometric, z = hits.geometric, hits.normal
    if two_sided:
        turn = torch.where(outside, 1.0, -1.0)[:, None]
        geometric, z = geometric * turn, z * turn
        outside = torch.ones_like(outside)
    away = ((direction * z).sum(-1) < 0) != outside
    z = torch.where(away[:, None], geometric, z)
    x = hits.tangent - (hits.tangent * z).sum(-1, keepdim=True) * z
    degenerate = (x * x).sum(-1, keepdim=True) <= 1e-12 * (hits.tangent * hits.tangent).sum(-1, keepdim=True)
    any_x = torch.stack(torch.broadcast_tensors(*orthonormal_basis(Vec3(*z.unbind(-1)))[0]), -1)
    x = normalize(torch.where(degenerate, any_x, x), dim=-1)
    y = torch.linalg.cross(z, x)
    vertex = ShadingPoint(hits.point, geometric, x, y, z, outside, direction.to(dtype))
    return vertex._replace(wi=vertex.to_local(-direction))


def radiance(scene: Scene, origin: Tensor, direction: Tensor, generator: torch.Generator) -> Tensor:
    """Radiance (n, 3) that arrives along each ray, one path each."""
    hits = scene.shape.intersect(origin, direction)
    total = torch.zeros_like(direction)
    missed = (~hits.found).nonzero()[:, 0]
    if scene.background and len(missed):
        total[missed] = scene.light.radiance(direction[missed])
    alive = hits.found.nonzero()[:, 0]
    vertex = shading_point(
        Hits(*(part[alive] for part in hits)), direction[alive], not scene.transmits, scene.bsdf.dtype
    )
    carried = torch.ones(len(alive), 1, dtype=torch.float64)
    for segment in range(scene.inner + 1 if scene.transmits else 1):
        if len(alive) == 0:
            break
        total.index_add_(
            0, alive, carried * (by_light_sample(scene, vertex, generator) + by_bsdf_sample(scene, vertex, generator))
        )
        if not scene.transmits or segment == scene.inner:
            break
        # The walk itself is perfect importance sampling: its weight does not pile up noise from segment to segment.
        u = scene.bsdf.uniforms((len(alive),), generator=generator)
        wo, weight, _ = (part[:, 0] for part in scene.bsdf.sample_walk(vertex.wi, u))
        towards = vertex.to_world(wo)
        _, enters = _sides(vertex, wo, towards)
        inside = (enters & (weight > 0).any(-1)).nonzero()[:, 0]
        towards = towards[inside]
        hits = scene.shape.intersect(_start(scene, vertex.rows(inside), towards), towards)
        # A ray that slips through an edge, or meets the outer side of a body that intersects itself, is lost.
        found = (hits.found & ((hits.geometric * towards).sum(-1) > 0)).nonzero()[:, 0]
        inside, towards = inside[found], towards[found]
        alive, carried = alive[inside], carried[inside] * weight[inside].double()
        vertex = shading_point(Hits(*(part[found] for part in hits)), towards, False, scene.bsdf.dtype)
    return total


def by_bsdf_sample(scene: Scene, vertex: ShadingPoint, generator: torch.Generator) -> Tensor:
    """Light (n, 3) from a direction that the BSDF was sampled for, scattered towards the camera."""
    total = torch.zeros_like(vertex.point)
    if scene.light.is_delta or scene.sampling == "light":
        return total
    u = scene.bsdf.uniforms((len(total),), generator=generator)
    wo, density = (part[:, 0] for part in scene.bsdf.sample(vertex.wi, u))
    direction = vertex.to_world(wo)
    leaves, _ = _sides(vertex, wo, direction)
    seen = (leaves & (density > 0)).nonzero()[:, 0]
    clear = ~scene.shape.blocked(_start(scene, vertex.rows(seen), direction[seen]), direction[seen])
    seen = seen[clear]
    vertex, wo, direction, density = vertex.rows(seen), wo[seen], direction[seen], density[seen].double()
    share = _share(scene, density, scene.light.pdf(direction))
    total[seen] = _value(scene, vertex, wo, generator) * scene.light.radiance(direction) * (share / density)[:, None]
    return total


def by_light_sample(scene: Scene, vertex: ShadingPoint, generator: torch.Generator) -> Tensor:
    """Light (n, 3) from a direction that the light was sampled for, scattered towards the camera."""
    total = torch.zeros_like(vertex.point)
    if scene.sampling == "bsdf" and not scene.light.is_delta:
        return total
    u = draw((len(total),), 1, 2, generator=generator, dtype=torch.float64)[:, 0]
    direction, coming, density = scene.light.sample(u)
    leaves, _ = _sides(vertex, vertex.to_local(direction), direction)
    seen = leaves.nonzero()[:, 0]
    vertex, direction = vertex.rows(seen), direction[seen]
    clear = ~scene.shape.blocked(_start(scene, vertex, direction), direction)
    seen, vertex, direction = seen[clear], vertex.rows(clear), direction[clear]
    wo = vertex.to_local(direction)
    value = _value(scene, vertex, wo, generator) * coming[seen]
    share = torch.ones(())
    if not scene.light.is_delta:
        share = _share(scene, density[seen], scene.bsdf.pdf(vertex.wi, wo).double())
    total[seen] = value * (share / density[seen])[:, None]
    return total


def _share(scene: Scene, chosen: Tensor, other: Tensor) -> Tensor:
    """Balance heuristic of a direction drawn with the density `chosen`, that could be drawn with `other`, too."""
    return chosen / (chosen + other) if scene.sampling == "mis" else torch.ones_like(chosen)


def _value(scene: Scene, vertex: ShadingPoint, wo: Tensor, generator: torch.Generator) -> Tensor:
    """f · |cos θ_o| (n, 3) by one path of the BSDF."""
    u = scene.bsdf.uniforms((len(wo),), generator=generator)
    return scene.bsdf(vertex.wi, wo, u).double().expand(-1, 3)


def _sides(vertex: ShadingPoint, wo: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Whether a direction leads out into the open, or into the body; neither where the two normals disagree."""
    out = (vertex.geometric * direction).sum(-1) > 0
    agree = (wo[:, 2] > 0) == out
    return out & agree, ~out & agree


def _start(scene: Scene, vertex: ShadingPoint, direction: Tensor) -> Tensor:
    return scene.shape.offset(vertex.point, vertex.geometric, direction)
