"""The frame of a shading point: world space to local space, +z the normal, and back."""

import torch
from torch import Tensor

from torchms.evaluation.arguments import check_finite
from torchms.maths.frame import Vec3, check_direction, dot, join, normalized, scaled, select, split
from torchms.maths.numerics import safe_div, smallest
from torchms.typing import Direction, Mask

PARALLEL = {torch.float32: 1e-10, torch.float64: 1e-20}
"""sin² of the angle between normal and tangent below which the tangent says nothing."""


def cross(a: Vec3, b: Vec3) -> Vec3:
    """a × b."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def is_vector(v: Vec3) -> Tensor:
    """Whether `v` is long enough to have a direction: zero vectors stand for pixels where nothing is."""
    return dot(v, v) > smallest(v.z.dtype)


def continuous_tangent(n: Vec3) -> Vec3:
    """A unit tangent of the unit vector `n`, continuous on the whole sphere but straight down, where none can be.

    It is (1, 0, 0) turned the shortest way with the normal from (0, 0, 1). Its gradient is zero straight down.
    """
    # Turning +z into n takes +x to (1 − x² / (1 + z), −x y / (1 + z), −x). Below the horizon 1 + z cancels, and is
    # ρ² / (1 − z) with ρ² = x² + y².
    below = n.z < 0
    rho2 = n.x * n.x + n.y * n.y
    inverse = torch.where(
        below, safe_div(1 - n.z, torch.where(below, rho2, 1.0)), 1 / (1 + torch.where(below, 0.0, n.z))
    )
    return normalized(Vec3(1 - n.x * n.x * inverse, -n.x * n.y * inverse, -n.x))


class ShadingFrame:
    """Local frames of shading points, right-handed and orthonormal whatever is given: x the tangent, z the normal.

    normal: (*batch, 3), of any length, as an interpolated one is; where it is zero the frame is the world's, and `valid` is
    false. tangent: (*batch, 3), the direction of alpha_x; what is along the normal is taken off. Where it is zero or along
    the normal, and where none is given, it is continuous in the normal everywhere but straight down.
    Raises TypeError or ValueError if a shape does not fit; in checked mode also for NaN and infinity.
    """

    normal: Vec3
    tangent: Vec3
    bitangent: Vec3

    def __init__(self, normal: Tensor, tangent: Tensor | None = None) -> None:
        check_direction(normal, "normal")
        if tangent is not None:
            check_direction(tangent, "tangent")
        check_finite({"normal": normal} if tangent is None else {"normal": normal, "tangent": tangent})
        given = split(normal)
        self.valid: Mask = is_vector(given)
        """Where there is a normal, (*batch)."""
        n = self.normal = normalized(given)
        t = continuous_tangent(n)
        if tangent is not None:
            wished = normalized(split(tangent))
            along = dot(wished, n)
            across = Vec3(wished.x - along * n.x, wished.y - along * n.y, wished.z - along * n.z)
            useful = is_vector(split(tangent)) & (dot(across, across) > PARALLEL[n.z.dtype])
            t = select(useful, normalized(select(useful, across, t)), t)
        # Once more: the first time left as much along the normal as rounding does.
        rest = dot(t, n)
        self.tangent = normalized(Vec3(t.x - rest * n.x, t.y - rest * n.y, t.z - rest * n.z))
        self.bitangent = cross(n, self.tangent)

    def facing(self, view: Direction) -> "ShadingFrame":
        """These frames turned over, tangents kept, wherever `view` is below the horizon: two-sided surfaces."""
        return self._turned(split(view))

    def _turned(self, view: Vec3) -> "ShadingFrame":
        sign = torch.where(dot(self.normal, view) < 0, -1.0, 1.0).to(self.normal.z.dtype)
        turned = object.__new__(ShadingFrame)
        turned.valid, turned.tangent = self.valid, self.tangent
        turned.normal, turned.bitangent = scaled(self.normal, sign), scaled(self.bitangent, sign)
        return turned

    def to_local(self, w: Tensor) -> Tensor:
        """World vectors (*batch, 3) in the local frame; lengths stay."""
        return columns(self._local(split(w)))

    def to_world(self, d: Tensor) -> Tensor:
        """Local vectors (*batch, 3) in the world: the inverse of `to_local`."""
        return columns(self._world(split(d)))

    def _local(self, w: Vec3) -> Vec3:
        return Vec3(dot(w, self.tangent), dot(w, self.bitangent), dot(w, self.normal))

    def _world(self, d: Vec3) -> Vec3:
        t, b, n = self.tangent, self.bitangent, self.normal
        return Vec3(
            d.x * t.x + d.y * b.x + d.z * n.x, d.x * t.y + d.y * b.y + d.z * n.y, d.x * t.z + d.y * b.z + d.z * n.z
        )

    def __repr__(self) -> str:
        return f"ShadingFrame(<{tuple(join(self.normal).shape)}>)"


def columns(v: Vec3) -> Tensor:
    """(…, 3) whose components are contiguous each, which is what kernels read fastest."""
    return torch.stack(torch.broadcast_tensors(*v)).movedim(0, -1)
