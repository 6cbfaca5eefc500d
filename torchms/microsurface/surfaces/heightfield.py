"""Explicit microsurfaces: one periodic tile of heights over a regular grid, two triangles a cell."""

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torchms.microsurface.surfaces.differences import forward, plane, rms
from torchms.microsurface.surfaces.files import encoded, read_heights, read_mesh
from torchms.microsurface.surfaces.holes import check_resolved, filled, units
from torchms.microsurface.surfaces.mesh import grid_of_mesh, mesh_of_grid
from torchms.microsurface.surfaces.report import report
from torchms.microsurface.surfaces.synthesis import MAX_SLOPE_CHANGE, checked_alpha, gaussian_heights
from torchms.slopes.heights import Length, Spacing, checked_heights, checked_spacing
from torchms.storage.write import check_writable, write_whole

if TYPE_CHECKING:
    import trimesh

    from torchms.distributions import Tabulated


@dataclass(frozen=True)
class Heightfield:
    """One tile of a microsurface that repeats without end along x and y.

    heights: (n_x, n_y) float64; `heights[i, j]` is the height at (i · dx, j · dy), in the unit of `spacing` = (dx, dy).
    Each cell is split along its (i + 1, j)–(i, j + 1) diagonal, so a facet's slopes are forward differences of the
    heights and every difference serves exactly two facets: the slope rms of the facets is that of the differences.
    Build one with `gaussian`, `from_heights`, `from_mesh` or `from_file`.
    """

    heights: np.ndarray
    spacing: tuple[Length, Length]

    def __post_init__(self) -> None:
        checked_heights(self.heights, "Heightfield(heights=...)")
        checked_spacing(self.spacing, "Heightfield(spacing=...)")

    @staticmethod
    def gaussian(
        alpha: float | int,
        alpha_y: float | int | None = None,
        *,
        size: int = 1024,
        texels_per_correlation: float | int = 16.0,
        seed: int,
    ) -> "Heightfield":
        """Gaussian random heights with slope variances α_x²/2, α_y²/2: a Beckmann microsurface (docs/theory.md, section 10).

        size: texels along each edge of the tile. texels_per_correlation: texels in one correlation length l, where
        the autocorrelation is exp(−r²/l²); l along x is the unit of length. The slope rms of the facets is exact on
        both axes: the heights are scaled to α_x, then dy is chosen for α_y, so both axes are resolved equally well
        however anisotropic the surface is.
        Raises ValueError if the texels cannot resolve the slopes, and says the size that can.
        """
        where = "Heightfield.gaussian"
        ax = checked_alpha(alpha, f"{where}(alpha=...)")
        ay = ax if alpha_y is None else checked_alpha(alpha_y, f"{where}(alpha_y=...)")
        return Heightfield(*gaussian_heights(ax, ay, size, texels_per_correlation, seed))

    @staticmethod
    def from_heights(heights: Any, spacing: Spacing, *, periodic: bool = False, level: bool = True) -> "Heightfield":
        """A surface of your own: `heights[i, j]` at (i · dx, j · dy), in the unit of `spacing` (dx, or (dx, dy)).

        periodic: the array tiles without a seam. Otherwise the tile is the array and its mirror images, which has no
        cliff at the seam and the same slope magnitudes. level: take off the least-squares plane first (tilted samples).
        Raises ValueError for heights that are not a finite 2-D array of at least 4 × 4, or a spacing not above 0.
        """
        h = np.array(checked_heights(np.asarray(heights), "Heightfield.from_heights(heights=...)"), dtype=np.float64)
        if level and not periodic:
            h -= plane(h)
        h -= h.mean()
        if not periodic:
            h = np.concatenate([h, h[::-1]], axis=0)
            h = np.concatenate([h, h[:, ::-1]], axis=1)
        surface = Heightfield(h, checked_spacing(spacing, "Heightfield.from_heights(spacing=...)"))
        change = surface.texel_slope_change
        if change > MAX_SLOPE_CHANGE:
            warnings.warn(
                f"Heightfield.from_heights: the slope changes by {change:.2f} (rms) from texel to texel, more than "
                f"the {MAX_SLOPE_CHANGE} a triangle mesh resolves: orders above 2 will depend on the texels. Measure "
                f"with a spacing about {change / MAX_SLOPE_CHANGE:.1f} times finer, or low-pass the noise.",
                stacklevel=2,
            )
        return surface

    @staticmethod
    def from_mesh(mesh: "trimesh.Trimesh", *, periodic: bool = False, level: bool = True) -> "Heightfield":
        """The surface of a mesh whose vertices stand on a regular x-y grid, without holes or overhangs.

        `periodic`: its last row and column repeat the first (what `.mesh` makes); then they are dropped. Else see
        `from_heights`. Raises ValueError if the mesh is not such a heightfield, and says why.
        """
        heights, spacing = grid_of_mesh(mesh)
        if periodic:
            step = max(float(np.abs(heights).max()), 1e-30) * 1e-6
            seam = max(np.abs(heights[-1] - heights[0]).max(), np.abs(heights[:, -1] - heights[:, 0]).max())
            if seam > step:
                raise ValueError(
                    f"Heightfield.from_mesh(periodic=True): first and last row differ by up to {seam:.3g}; they must "
                    "be equal for the tile to repeat. Pass periodic=False to mirror it instead."
                )
            heights = heights[:-1, :-1]
        return Heightfield.from_heights(heights, spacing, periodic=periodic, level=level)

    @staticmethod
    def from_file(
        path: str | Path,
        spacing: Spacing | None = None,
        *,
        height_scale: float | int | None = None,
        periodic: bool = False,
        level: bool = True,
        fill: bool = False,
    ) -> "Heightfield":
        """A height map (16-bit PNG or TIFF, float TIFF, .npy), a scan (.x3p, text, …) or a mesh (.ply, .obj, .stl, …) on disk.

        spacing: as in `from_heights`; asked for unless the file says it, as .x3p and text of points (.xyz) do.
        height_scale: what the map's values are multiplied by to be in the unit of `spacing`; 1, but asked for where they
        are 16-bit steps. Both are ignored for a mesh. An image's columns run along x and its rows along y; `.npy` is taken
        as `heights[i, j]` of `from_heights`. fill: close holes of the measurement smoothly (see `filled`).
        Raises ValueError for a file that is damaged or too large, for holes unless they are filled, for units that nobody
        says, and for a map so coarse that the slopes of neighbours have nothing to do with each other.
        """
        mesh = read_mesh(path)
        if mesh is not None:
            return Heightfield.from_mesh(mesh, periodic=periodic, level=level)
        where = "Heightfield.from_file"
        if height_scale is not None and not (math.isfinite(height_scale) and height_scale > 0):
            raise ValueError(
                f"{where}(height_scale=...) must be finite and above 0; got {height_scale}. "
                "It is the height of one step of the map's values."
            )
        scan = read_heights(path)
        heights = filled(scan.heights) if fill else scan.heights
        heights = checked_heights(heights, f"{where}: the heights of {path}")
        step, scale = units(scan, path, spacing, height_scale, where)
        check_resolved(heights * scale, step, f"{where}: {path}")
        return Heightfield.from_heights(heights * scale, step, periodic=periodic, level=level)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells of the tile along x and y."""
        return (self.heights.shape[0], self.heights.shape[1])

    @property
    def extent(self) -> tuple[float, float]:
        """Period along x and y, in the unit of `spacing`."""
        return (self.heights.shape[0] * self.spacing[0], self.heights.shape[1] * self.spacing[1])

    @property
    def n_triangles(self) -> int:
        """Facets of one tile."""
        return 2 * self.heights.size

    @cached_property
    def slope_variance(self) -> tuple[float, float]:
        """Variance of the facets' slopes along x and y."""
        return (
            float(np.mean((forward(self.heights, 0) / self.spacing[0]) ** 2)),
            float(np.mean((forward(self.heights, 1) / self.spacing[1]) ** 2)),
        )

    @property
    def alpha(self) -> tuple[float, float]:
        """α_x, α_y that a Beckmann surface of the same slope variances has, √(2 · variance)."""
        vx, vy = self.slope_variance
        return (math.sqrt(2 * vx), math.sqrt(2 * vy))

    @cached_property
    def texel_slope_change(self) -> float:
        """rms change of slope between neighbouring facets along an axis, the larger of the two axes."""
        change = [rms(forward(forward(self.heights, axis), axis)) / step for axis, step in enumerate(self.spacing)]
        return float(max(change))

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":
        """One tile as a triangle mesh, (n_x + 1)(n_y + 1) vertices; the last row and column repeat the first."""
        return mesh_of_grid(np.pad(self.heights, ((0, 1), (0, 1)), mode="wrap"), self.spacing)

    def distribution(self, components: int = 16) -> "Tabulated":
        """The slopes of the tile's facets as a distribution for any BSDF, of at most so many Gaussian components."""
        from torchms.distributions import Tabulated  # and torch, which a surface alone does not need

        return Tabulated.from_heights(self.heights, self.spacing, periodic=True, components=components)

    def export(self, path: str | Path, *, force: bool = False) -> None:
        """Write the tile: .npy holds the heights, any other suffix (.ply, .obj, .stl, …) `mesh`, by trimesh.

        Atomic. Raises FileExistsError if `path` exists and not `force`.
        """
        target = check_writable(path, force)
        write_whole(target, encoded(target, self.heights, lambda: self.mesh), force)

    def report(self, bins: int = 64) -> dict[str, Any]:
        """What the surface is like, JSON-serialisable: see `torchms.microsurface.surfaces.report`."""
        return report(self.heights, self.spacing, bins) | {
            "triangles": self.n_triangles,
            "slope_variance": list(self.slope_variance),
            "alpha": list(self.alpha),
            "texel_slope_change": self.texel_slope_change,
        }
