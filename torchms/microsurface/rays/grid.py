"""The frame that rays are traced in: cells along x and y, and heights in a unit that makes every surface α ≈ 1."""

import math
from dataclasses import dataclass

import numpy as np

from torchms.microsurface.surfaces.heightfield import Heightfield

ESCAPED = -1
LEAKED = -2
"""What a cast writes in place of a facet's number."""


@dataclass(frozen=True)
class Grid:
    """A heightfield in its grid frame; incidence is affine-invariant, so both tracers may work here.

    heights: (n_x, n_y) float32, mean zero; both tracers take exactly these numbers, so they see the same triangles.
    scale: (3,) float64, turns a world direction into a grid direction. kx, ky: turn height steps per cell into slopes.
    top, bottom: highest and lowest point. Scaling the heights by the slope rms makes offsets and float32 behave alike
    at every α and every anisotropy that is a stretch.
    """

    heights: np.ndarray
    scale: np.ndarray
    kx: float
    ky: float
    top: float
    bottom: float

    @staticmethod
    def of(surface: Heightfield) -> "Grid":
        """The grid frame of `surface`."""
        dx, dy = surface.spacing
        vx, vy = surface.slope_variance
        slope = math.sqrt(vx + vy)
        dz = dx * slope if slope > 0 else dx
        h = surface.heights
        g = np.ascontiguousarray((h - h.mean()) / dz, dtype=np.float32)
        scale = np.array([1 / dx, 1 / dy, 1 / dz])
        return Grid(g, scale, dz / dx, dz / dy, float(g.max()), float(g.min()))

    @property
    def launch_height(self) -> float:
        """Where rays start [grid units]: a little above the highest point."""
        return self.top + 1e-2 + 1e-3 * (self.top - self.bottom)


@dataclass
class Paths:
    """State of a batch of light paths; the first `n` entries live.

    x, y, z: place in the grid frame. d: (N, 3) world direction of propagation. tri: facet the path is on, or −1
    before the first; after a cast also ESCAPED, LEAKED. side: +1 above the surface, −1 below. ray: number in its shard.
    weight: (N, C) energy of the path, for materials whose facets absorb; (0, C) otherwise.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    d: np.ndarray
    tri: np.ndarray
    side: np.ndarray
    ray: np.ndarray
    weight: np.ndarray
    n: int

    @staticmethod
    def empty(capacity: int, channels: int, weighted: bool) -> "Paths":
        """Room for `capacity` paths."""
        return Paths(
            x=np.empty(capacity),
            y=np.empty(capacity),
            z=np.empty(capacity),
            d=np.empty((capacity, 3)),
            tri=np.empty(capacity, dtype=np.int32),
            side=np.empty(capacity),
            ray=np.empty(capacity, dtype=np.int64),
            weight=np.ones((capacity if weighted else 0, channels)),
            n=0,
        )
