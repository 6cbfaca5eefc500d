"""The second tracer: a float64 walk over the heights themselves, without a mesh and without Embree."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from torchms.extras import missing
from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.rays.tracer import Caster, TraceCount, Tracer


@dataclass(frozen=True)
class GridTracer(Tracer):
    """Exact walk through the cells in float64 (Numba); shares no code with `EmbreeTracer`, so each checks the other.

    It needs no offset and no tree, so a surface is ready at once. Raises ImportError where Numba is missing.
    """

    def require(self) -> None:
        """See `Tracer`."""
        require_numba()

    def bind(self, grid: Grid) -> "GridCaster":
        """Bound the heights of each block of cells."""
        from torchms.microsurface.rays.grid_walk_kernel import COARSE, FINE, block_bounds

        return GridCaster(grid, *block_bounds(grid.heights, FINE), *block_bounds(grid.heights, COARSE))

    def describe(self) -> dict[str, Any]:
        """See `Tracer`."""
        return {"tracer": "GridTracer"}


@dataclass(frozen=True)
class GridCaster(Caster):
    """`GridTracer` on one surface; holds nothing that a cast changes, so threads may share it."""

    grid: Grid
    top: np.ndarray
    bottom: np.ndarray
    far_top: np.ndarray
    far_bottom: np.ndarray

    def cast(self, paths: Paths) -> TraceCount:
        """See `Caster`."""
        from torchms.microsurface.rays.grid_walk_kernel import walk

        g, p = self.grid, paths
        bounds = (self.top, self.bottom, self.far_top, self.far_bottom)
        leaked = walk(g.heights, *bounds, g.scale, p.x, p.y, p.z, p.d, p.tri, p.side, p.n)
        return TraceCount(leaked=leaked, casts=p.n)


def require_numba() -> None:
    """Raise ImportError that says how to get Numba, if it is missing."""
    try:
        import_module("numba")
    except ImportError as error:
        raise missing("torchms.microsurface", "numba") from error
