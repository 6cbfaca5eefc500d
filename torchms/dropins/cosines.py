"""What the formulas of one bounce are functions of: four cosines."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.frame import Vec3, check_direction, dot, half_vector, normalized, scaled, split
from torchms.shading.frame import is_vector


class Cosines(NamedTuple):
    """Of the light, the view and the half vector with the normal, and of the view with the half vector, each (*batch).

    there: where no vector was zero, as in a background pixel it is.
    """

    light: Tensor
    view: Tensor
    half: Tensor
    met: Tensor
    there: Tensor

    def clamped(self, low: float, high: float = 1.0) -> "Cosines":
        """All of them in [low, high]; without a gradient where they were not."""
        light, view, half, met = (cosine.clamp(low, high) for cosine in self[:4])
        return Cosines(light, view, half, met, self.there)


def cosines(normal: Tensor, view: Tensor, light: Tensor, two_sided: bool = False) -> Cosines:
    """Of vectors (*batch, 3) of any length that broadcast; `two_sided` turns the normal to the view."""
    for name, vector in {"normal": normal, "view": view, "light": light}.items():
        check_direction(vector, name)
    given: list[Vec3] = [split(vector) for vector in (normal, view, light)]
    there = is_vector(given[0]) & is_vector(given[1]) & is_vector(given[2])
    n, v, d = (normalized(vector) for vector in given)
    if two_sided:
        n = scaled(n, torch.where(dot(n, v) < 0, -1.0, 1.0).to(n.z.dtype))
    h = half_vector(v, d)
    return Cosines(dot(n, d), dot(n, v), dot(n, h), dot(v, h), there)
