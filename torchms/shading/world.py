"""What a camera sees of lights, and where it pays to look for them: BSDFs in world space."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.bsdfs import BSDF
from torchms.evaluation.arguments import check_values
from torchms.maths.frame import Vec3, check_direction, normalized, select, split
from torchms.maths.numerics import away_from_zero, horizon
from torchms.sampling.stream import Stream
from torchms.shading.frame import ShadingFrame, columns, is_vector


class LightSample(NamedTuple):
    """Directions towards lights (N, *batch, 3), drawn with density `pdf` (N, *batch) [1/sr], which is exact.

    The N samples lead, so that they broadcast against the maps of a material: `shade(material, normal, view, *light*)`
    takes them as they are, and the mean over the first axis of value / pdf · radiance is what the camera sees.
    """

    light: Tensor
    pdf: Tensor


def shade(
    material: BSDF,
    normal: Tensor,
    view: Tensor,
    light: Tensor,
    u: Tensor | Stream | None = None,
    *,
    tangent: Tensor | None = None,
    two_sided: bool = False,
    cosine: bool = True,
    normalize: bool = False,
    block: int | None = None,
) -> Tensor:
    """f(view, light) · |cos θ_light| [1/sr], (*batch, C), of world-space vectors that point away from the surface.

    normal, view, light, tangent: (*batch, 3), broadcast with each other and with the maps of `material`: L lights before N
    pixels are (L, N, 3), after them normal and view are (N, 1, 3) and maps (N, 1). normal and tangent: see `ShadingFrame`;
    view and light: unit vectors, or of any length if `normalize`. Where a vector is zero, as in a background pixel, the value
    is 0. u: random numbers (*batch, N, D) or a `Stream`, where the material needs them.
    two_sided: the normal is turned to the view. cosine: with |cos θ_light|, or f alone, which is 0 at and below the horizon.
    block: as in `BSDF.forward`. Raises TypeError or ValueError if a shape, a dtype or a length does not fit.
    """
    frame, there = _prepared(normal, {"view": view, "light": light}, tangent, two_sided, normalize)
    wi, wo = (frame._local(w) for w in there.vectors)
    value = material(columns(wi), columns(wo), u, block=block)
    if not cosine:
        value = value / away_from_zero(wo.z, horizon(wo.z.dtype)).abs().unsqueeze(-1)
    return torch.where(there.valid.unsqueeze(-1), value, 0.0)


def sample(
    material: BSDF,
    normal: Tensor,
    view: Tensor,
    u: Tensor | Stream,
    *,
    tangent: Tensor | None = None,
    two_sided: bool = False,
    normalize: bool = False,
    block: int | None = None,
) -> LightSample:
    """Directions towards lights, close to the shape of `shade` seen from `view`, with their density: one a path of `u`.

    Arguments as for `shade`. Where a vector is zero, and for a view on a side that the surface does not serve, pdf is 0.
    """
    frame, there = _prepared(normal, {"view": view}, tangent, two_sided, normalize)
    (w,) = there.vectors
    wo, pdf = material.sample(columns(frame._local(w)), u, block=block)
    light = frame._world(Vec3(*wo.movedim(-2, 0).unbind(-1)))
    return LightSample(columns(light), torch.where(there.valid, pdf.movedim(-1, 0), 0.0))


class _Vectors(NamedTuple):
    """Unit vectors, and where none of them and no normal was zero."""

    vectors: list[Vec3]
    valid: Tensor


def _prepared(
    normal: Tensor, given: dict[str, Tensor], tangent: Tensor | None, two_sided: bool, normalize: bool
) -> tuple[ShadingFrame, _Vectors]:
    """The frames, turned to the view if `two_sided`, and the vectors, which are the normal where they are zero."""
    frame = ShadingFrame(normal, tangent)
    for name, w in given.items():
        check_direction(w, name)
    _check_shapes({"normal": normal, **given} | ({} if tangent is None else {"tangent": tangent}))
    valid, vectors = frame.valid, []
    for name, w in given.items():
        components = split(w)
        present = is_vector(components)
        valid = valid & present
        components = select(present, components, frame.normal)
        if normalize:
            components = normalized(components)
        else:
            check_values(None, {name: columns(components)}, None)
        vectors.append(components)
    return (frame._turned(vectors[0]) if two_sided else frame), _Vectors(vectors, valid)


def _check_shapes(vectors: dict[str, Tensor]) -> None:
    """Raise ValueError if batches of these vectors do not broadcast."""
    try:
        torch.broadcast_shapes(*(w.shape[:-1] for w in vectors.values()))
    except RuntimeError:
        listing = ", ".join(f"{name} {tuple(w.shape)}" for name, w in vectors.items())
        raise ValueError(
            f"batch shapes do not broadcast: {listing}. For N pixels and L lights give normal and view as (N, 1, 3) and "
            "light as (N, L, 3), or light as (L, N, 3)."
        ) from None
