"""Where each single light path leaves an explicit surface: directions themselves, without bins."""

from dataclasses import dataclass, replace

import numpy as np

from torchms.microsurface.rays.grid import ESCAPED, Grid, Paths
from torchms.microsurface.rays.grid_walk import GridCaster
from torchms.microsurface.simulation.materials import FacetMaterial


@dataclass(frozen=True)
class Exits:
    """One row a path, in the order of its direction of incidence.

    wo: (n, 3) float32 unit vectors away from the surface. order: (n,) uint8 facet events; 0 for a path that had not left
    after the last one, or leaked. steep: (n,) float32, Σ (1 − c_l)⁵ over the cosines of incidence on the facets of a mirror.
    """

    wo: np.ndarray
    order: np.ndarray
    steep: np.ndarray


def stretched(caster: GridCaster, x: float, y: float) -> GridCaster:
    """The same tile with all slopes along x and y times these factors; its cells, which rays are traced in, stay."""
    grid = caster.grid
    scale = grid.scale * np.array([x, y, 1.0])
    return replace(caster, grid=Grid(grid.heights, scale, grid.kx * x, grid.ky * y, grid.top, grid.bottom))


def exits(caster: GridCaster, material: FacetMaterial, wi: np.ndarray, key: np.ndarray, max_order: int) -> Exits:
    """Trace one path for each unit vector of `wi` (n, 3) above the horizon; they start all over the tile.

    key: (2,) uint32; with the number of a path it fixes where that starts, and what else is drawn.
    """
    from torchms.microsurface.simulation.launch import launch

    grid, n = caster.grid, len(wi)
    p = Paths.empty(n, material.channels, False)
    found = Exits(np.zeros((n, 3), np.float32), np.zeros(n, np.uint8), np.zeros(n, np.float32))
    p.n = n
    up = np.array([0.0, 0.0, 1.0])
    nx, ny = grid.heights.shape
    launch(0, n, key, up, nx, ny, grid.launch_height, p.x, p.y, p.z, p.d, p.tri, p.side, p.ray, n)
    p.d[:] = -wi
    for events in range(max_order + 1):
        if events:
            before = p.d[: p.n].copy()
            material.scatter(p, grid, events, key, False)
            # A mirror turns d by 2 c along its normal.
            cosine = np.minimum(0.5 * np.linalg.norm(p.d[: p.n] - before, axis=1), 1.0)
            found.steep[p.ray[: p.n]] += (1 - cosine) ** 5
        caster.cast(p)
        left = p.tri[: p.n] == ESCAPED
        rays = p.ray[: p.n][left]
        found.wo[rays] = p.d[: p.n][left]
        found.order[rays] = events
        stays = p.tri[: p.n] >= 0
        m = int(stays.sum())
        for x in (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray):
            x[:m] = x[: p.n][stays]
        p.n = m
        if not m:
            break
    return found
