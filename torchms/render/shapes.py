"""What rays meet. Positions are float64, (n, 3)."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import normalize


class Hits(NamedTuple):
    """First surface along each ray.

    found: (n,) whether there is one; the rest is arbitrary where not. point: (n, 3). geometric: (n, 3) unit normal of
    the surface itself, outwards. normal: (n, 3) unit shading normal. tangent: (n, 3) direction that α_x lies along,
    not necessarily orthogonal to `normal`; zero where there is none.
    """

    found: Tensor
    point: Tensor
    geometric: Tensor
    normal: Tensor
    tangent: Tensor


class Shape(ABC):
    """A surface in space.

    is_closed: whether it has an inside. centre, radius: of a ball around it.
    """

    is_closed: bool
    centre: tuple[float, float, float]
    radius: float

    @abstractmethod
    def intersect(self, origin: Tensor, direction: Tensor) -> Hits:
        """The first hit of each ray (n, 3), unit directions."""

    @abstractmethod
    def blocked(self, origin: Tensor, direction: Tensor) -> Tensor:
        """(n,) whether anything is met along each ray."""

    def offset(self, point: Tensor, geometric: Tensor, direction: Tensor) -> Tensor:
        """Where a ray along `direction` starts so that it does not meet the surface it leaves."""
        side = torch.where((geometric * direction).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        return point + geometric * (side * (1e-5 * self.radius))


class Sphere(Shape):
    """The unit sphere about the origin, exactly: facets would darken a furnace at the rim. α_x is along parallels."""

    is_closed = True
    centre = (0.0, 0.0, 0.0)
    radius = 1.0

    def _distance(self, origin: Tensor, direction: Tensor) -> Tensor:
        """To the first point ahead; infinite if there is none."""
        b = (origin * direction).sum(-1)
        # The squared distance of the line from the centre, without the cancellation of b² − |o|².
        miss2 = ((origin - b[:, None] * direction) ** 2).sum(-1)
        half = (1 - miss2).clamp_min(0).sqrt()
        near, far = -b - half, -b + half
        t = torch.where(near > 0, near, far)
        return torch.where((miss2 < 1) & (t > 0), t, torch.inf)

    def intersect(self, origin: Tensor, direction: Tensor) -> Hits:
        t = self._distance(origin, direction)
        found = t.isfinite()
        n = normalize(origin + torch.where(found, t, 0.0)[:, None] * direction, dim=-1)
        tangent = torch.stack([n[:, 2], torch.zeros_like(n[:, 0]), -n[:, 0]], -1)
        return Hits(found, n, n, n, tangent)

    def blocked(self, origin: Tensor, direction: Tensor) -> Tensor:
        return self._distance(origin, direction).isfinite()
