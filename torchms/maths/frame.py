"""Directions inside the package: three component tensors, never one (..., 3) tensor.

Component-split kernels are what both eager mode and Inductor run fast; `split` and `join` are the only
two places where the layout changes.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.numerics import safe_sqrt, smallest, widened


class Vec3(NamedTuple):
    """A batch of vectors as its components; `x`, `y` and `z` broadcast against each other."""

    x: Tensor
    y: Tensor
    z: Tensor

    def __neg__(self) -> "Vec3":
        return Vec3(-self.x, -self.y, -self.z)


FROM_ANGLES = "Angles theta and phi [rad] are the direction (sin theta cos phi, sin theta sin phi, cos theta)."


def check_direction(w: object, name: str = "a direction") -> None:
    """Raise TypeError or ValueError if `w`, called `name` in the message, is no dense floating-point tensor (..., 3)."""
    if not isinstance(w, Tensor) or not w.is_floating_point() or w.layout != torch.strided:
        angle = f" {FROM_ANGLES}" if isinstance(w, int | float) else ""
        raise TypeError(f"{name} must be a floating-point Tensor (*batch, 3); got {kind_of(w)}.{conversion(w)}{angle}")
    if w.ndim == 0 or w.shape[-1] != 3:
        angles = f" {FROM_ANGLES}" if w.ndim and w.shape[-1] == 2 else ""
        raise ValueError(
            f"{name} must be (*batch, 3), components on the last axis; got shape {tuple(w.shape)}.{angles}"
        )


def kind_of(value: object) -> str:
    """What an argument is, for an error message."""
    if not isinstance(value, Tensor):
        return type(value).__name__
    return f"a Tensor of {value.dtype}" + ("" if value.layout == torch.strided else f", {value.layout}")


def conversion(value: object) -> str:
    """What turns numbers into a floating-point Tensor, as a sentence with a space before it; "" for anything else."""
    if isinstance(value, Tensor):
        return "" if value.is_floating_point() or value.is_complex() else " Write .float() behind it."
    is_array = hasattr(value, "__array__")
    return " Write torch.as_tensor(…, dtype=torch.float32)." if is_array or isinstance(value, list | tuple) else ""


def split(v: Tensor) -> Vec3:
    """The components of a (..., 3) tensor, at least float32. Raises TypeError or ValueError for anything else."""
    check_direction(v)
    return Vec3(*widened(v).unbind(-1))


def pair(u: Tensor) -> tuple[Tensor, Tensor]:
    """The two random numbers of a (..., 2) tensor, at least float32. Raises TypeError or ValueError for anything else."""
    if not isinstance(u, Tensor) or not u.is_floating_point():
        raise TypeError(f"u must be a floating-point Tensor (*batch, 2); got {kind_of(u)}.")
    if u.ndim == 0 or u.shape[-1] != 2:
        raise ValueError(f"u must be (*batch, 2), two random numbers on the last axis; got shape {tuple(u.shape)}.")
    first, second = widened(u).unbind(-1)
    return first, second


def join(v: Vec3) -> Tensor:
    """The (..., 3) tensor of three components."""
    return torch.stack(torch.broadcast_tensors(*v), dim=-1)


def direction(theta: float | int, phi: float | int = 0.0, dtype: torch.dtype = torch.float64) -> Tensor:
    """The unit vector (3,) at `theta` from the normal and azimuth `phi` [rad]."""
    sin = math.sin(theta)
    return torch.tensor([sin * math.cos(phi), sin * math.sin(phi), math.cos(theta)], dtype=dtype)


def scaled(v: Vec3, s: Tensor) -> Vec3:
    """s · v."""
    return Vec3(s * v.x, s * v.y, s * v.z)


def dot(a: Vec3, b: Vec3) -> Tensor:
    """a · b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def select(mask: Tensor, a: Vec3, b: Vec3) -> Vec3:
    """a where `mask`, else b."""
    return Vec3(torch.where(mask, a.x, b.x), torch.where(mask, a.y, b.y), torch.where(mask, a.z, b.z))


def normalized(v: Vec3) -> Vec3:
    """v / |v|. A vector too short to have a direction becomes +z, with a zero gradient."""
    length2 = dot(v, v)
    ok = length2 > smallest(length2.dtype)
    inverse = 1 / torch.sqrt(torch.where(ok, length2, 1.0))
    return Vec3(
        torch.where(ok, v.x * inverse, 0.0), torch.where(ok, v.y * inverse, 0.0), torch.where(ok, v.z * inverse, 1.0)
    )


def plus(w: Vec3, d: Vec3) -> Vec3:
    """w + d."""
    return Vec3(w.x + d.x, w.y + d.y, w.z + d.z)


def stacked(a: Vec3, b: Vec3) -> Vec3:
    """Both, along a first axis."""
    return Vec3(*(torch.stack(torch.broadcast_tensors(x, y)) for x, y in zip(a, b, strict=True)))


def half_vector(w: Vec3, d: Vec3) -> Vec3:
    """(w + d) / |w + d|."""
    return normalized(plus(w, d))


def cosine(w: Vec3, v: Vec3) -> Tensor:
    """w · v / |v|: with the direction of `v`, which is +z, with a zero gradient, where it is too short to have one."""
    length2 = dot(v, v)
    ok = length2 > smallest(length2.dtype)
    return torch.where(ok, dot(w, v) / torch.sqrt(torch.where(ok, length2, 1.0)), w.z)


def reflect(w: Vec3, m: Vec3) -> Vec3:
    """Mirror image of `w` about the normal `m`; both point away from the facet."""
    twice = 2 * dot(w, m)
    return Vec3(twice * m.x - w.x, twice * m.y - w.y, twice * m.z - w.z)


def refract(w: Vec3, m: Vec3, eta: Tensor) -> Vec3:
    """Direction of `w` after it passed the facet `m` [Walter2007, Eq. 40]; eta = n_transmitted / n_incident.

    Under total internal reflection, where there is no such direction, it is the grazing one.
    """
    cos_i = dot(w, m)
    # [Walter2007] writes o_t = (eta' c - sqrt(1 + eta'^2 (c^2 - 1))) m - eta' i with eta' = 1 / eta.
    inverse = 1 / eta
    cos_t = safe_sqrt(1 - inverse * inverse * (1 - cos_i * cos_i))
    along = inverse * cos_i - cos_t
    return Vec3(along * m.x - inverse * w.x, along * m.y - inverse * w.y, along * m.z - inverse * w.z)


def mirrored(v: Vec3) -> Vec3:
    """v with its z component negated: the image across the macro-surface."""
    return Vec3(v.x, v.y, -v.z)


def orthonormal_basis(n: Vec3) -> tuple[Vec3, Vec3]:
    """Two unit vectors that complete the unit vector `n` to a right-handed frame, without a branch on n.

    Any rotation of the pair about n would serve; the sign of n.z picks the pole that is divided by.
    """
    sign = torch.where(n.z >= 0, 1.0, -1.0).to(n.z.dtype)
    a = -1 / (sign + n.z)
    b = n.x * n.y * a
    return (
        Vec3(1 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3(b, sign + n.y * n.y * a, -n.y),
    )
