"""Where light comes from: a direction, or the whole sphere around the scene. Directions (n, 3), y up; linear sRGB."""

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import normalize

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Luminance of linear sRGB (Rec. 709)."""


class LightSample(NamedTuple):
    """direction: (n, 3) to the light. radiance: (n, 3). pdf: (n,) its density [1/sr], or 1."""

    direction: Tensor
    radiance: Tensor
    pdf: Tensor


class Light(ABC):
    """A light infinitely far away. is_delta: whether it is one direction, which no BSDF sample meets."""

    is_delta: bool

    @abstractmethod
    def sample(self, u: Tensor) -> LightSample:
        """Directions to the light, for numbers `u` (n, 2) in [0, 1)."""

    @abstractmethod
    def radiance(self, direction: Tensor) -> Tensor:
        """Radiance (n, 3) that comes from `direction`; 0 for a light of one direction."""

    @abstractmethod
    def pdf(self, direction: Tensor) -> Tensor:
        """Density (n,) of `sample` [1/sr]; 0 for a light of one direction."""


class DirectionalLight(Light):
    """Parallel light from `towards`; `irradiance` is that on a surface that faces it, in RGB or grey."""

    is_delta = True

    def __init__(self, towards: tuple[float, float, float], irradiance: float = 1.0) -> None:
        if not math.hypot(*towards) > 0:
            raise ValueError(
                f"DirectionalLight(towards=...) must be a direction; got {towards}. Give x y z to the light."
            )
        self.towards = normalize(torch.tensor(towards, dtype=torch.float64), dim=0)
        self.irradiance = irradiance

    def sample(self, u: Tensor) -> LightSample:
        n = len(u)
        radiance = torch.full((n, 3), self.irradiance, dtype=torch.float64)
        return LightSample(self.towards.expand(n, 3), radiance, torch.ones(n, dtype=torch.float64))

    def radiance(self, direction: Tensor) -> Tensor:
        return torch.zeros_like(direction)

    def pdf(self, direction: Tensor) -> Tensor:
        return torch.zeros_like(direction[:, 0])


class Environment(Light):
    """A latitude-longitude map (rows, columns, 3) of radiance: the first row is around +y, the middle column is −z.

    Each texel has one radiance. Directions are drawn in proportion to luminance × solid angle of the texels,
    uniformly within one, so that the density is exact. Raises ValueError for another shape, for negative or infinite
    numbers and for a map that is black everywhere.
    """

    is_delta = False

    def __init__(self, texels: Tensor) -> None:
        if texels.ndim != 3 or texels.shape[-1] != 3 or texels.numel() == 0:
            raise ValueError(f"Environment(texels=...) must be (rows, columns, 3); got {tuple(texels.shape)}.")
        texels = texels.double()
        if not bool(torch.isfinite(texels).all()) or bool((texels < 0).any()):
            raise ValueError("Environment(texels=...) must be finite and not negative. Clamp the map first.")
        self.texels = texels
        self.rows, self.columns = texels.shape[:2]
        edges = torch.cos(torch.linspace(0, math.pi, self.rows + 1, dtype=torch.float64))
        self._solid_angle = (edges[:-1] - edges[1:]) * (2 * math.pi / self.columns)
        self._cos_edges = edges
        power = (texels @ torch.tensor(LUMINANCE, dtype=torch.float64)) * self._solid_angle[:, None]
        if not float(power.sum()) > 0:
            raise ValueError("Environment(texels=...) must be bright somewhere; every texel is 0.")
        self._share = power.reshape(-1) / power.sum()
        self._cumulative = torch.cumsum(self._share, 0)
        self._density = self._share / self._solid_angle.repeat_interleave(self.columns)

    def sample(self, u: Tensor) -> LightSample:
        u = u.double()
        # The first number picks the texel; what is left of it is uniform again.
        texel = torch.searchsorted(self._cumulative, u[:, 0] * self._cumulative[-1], right=True)
        texel = texel.clamp_max(len(self._share) - 1)
        below = self._cumulative[texel] - self._share[texel]
        left = ((u[:, 0] * self._cumulative[-1] - below) / self._share[texel].clamp_min(1e-300)).clamp(0, 1 - 1e-12)
        row, column = texel // self.columns, texel % self.columns
        y = self._cos_edges[row] + (self._cos_edges[row + 1] - self._cos_edges[row]) * u[:, 1]
        phi = (column + left) * (2 * math.pi / self.columns)
        r = (1 - y * y).clamp_min(0).sqrt()
        direction = torch.stack([-r * phi.sin(), y, r * phi.cos()], -1)
        return LightSample(direction, self.texels.reshape(-1, 3)[texel], self._density[texel])

    def _texel(self, direction: Tensor) -> Tensor:
        # acos loses half of its digits at the poles; atan2 does not.
        theta = torch.atan2(torch.hypot(direction[:, 0], direction[:, 2]), direction[:, 1])
        row = (theta * (self.rows / math.pi)).long().clamp(0, self.rows - 1)
        phi = torch.atan2(-direction[:, 0], direction[:, 2]) % (2 * math.pi)
        column = (phi * (self.columns / (2 * math.pi))).long().clamp(0, self.columns - 1)
        return row * self.columns + column

    def radiance(self, direction: Tensor) -> Tensor:
        return self.texels.reshape(-1, 3)[self._texel(direction)]

    def pdf(self, direction: Tensor) -> Tensor:
        return self._density[self._texel(direction)]


class ConstantLight(Environment):
    """The same `radiance` from everywhere: a white furnace."""

    def __init__(self, radiance: float = 1.0) -> None:
        super().__init__(torch.full((1, 1, 3), radiance))
