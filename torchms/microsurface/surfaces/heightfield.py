"""Explicit microsurfaces: one periodic tile of heights over a regular grid, two triangles a cell."""

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import trimesh

# Second derivative of a Gaussian-correlated surface: rms h'' = √6 · (rms h') / l with C(r) = exp(−r²/l²), so the rms
# change of slope from one texel to the next is √6 · (α/√2) · texel / l = √3 α / texels_per_correlation.
SLOPE_CHANGE_PER_TEXEL = math.sqrt(3)
MAX_SLOPE_CHANGE = 0.25
MIN_CORRELATIONS = 8

Length = float | int
Spacing = Length | tuple[Length, Length]


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
        check_resolution(max(ax, ay), size, texels_per_correlation)
        h = _gaussian_correlated(size, texels_per_correlation, seed)
        dx = 1.0 / texels_per_correlation
        h *= ax / math.sqrt(2) / (_rms(_forward(h, 0)) / dx)
        dy = _rms(_forward(h, 1)) / (ay / math.sqrt(2))
        return Heightfield(h, (dx, dy))

    @staticmethod
    def from_heights(heights: Any, spacing: Spacing, *, periodic: bool = False, level: bool = True) -> "Heightfield":
        """A surface of your own: `heights[i, j]` at (i · dx, j · dy), in the unit of `spacing` (dx, or (dx, dy)).

        periodic: the array tiles without a seam. Otherwise the tile is the array and its mirror images, which has no
        cliff at the seam and the same slope magnitudes. level: take off the least-squares plane first (tilted samples).
        Raises ValueError for heights that are not a finite 2-D array of at least 4 × 4, or a spacing not above 0.
        """
        h = np.array(checked_heights(np.asarray(heights), "Heightfield.from_heights(heights=...)"), dtype=np.float64)
        if level and not periodic:
            h -= _plane(h)
        h -= h.mean()
        if not periodic:
            h = np.concatenate([h, h[::-1]], axis=0)
            h = np.concatenate([h, h[:, ::-1]], axis=1)
        pair = (spacing, spacing) if isinstance(spacing, int | float) else spacing
        surface = Heightfield(h, checked_spacing(pair, "Heightfield.from_heights(spacing=...)"))
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
        from torchms.microsurface.surfaces.mesh import grid_of_mesh

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
        spacing: Spacing = 1.0,
        *,
        height_scale: float | int = 1.0,
        periodic: bool = False,
        level: bool = True,
    ) -> "Heightfield":
        """A height map (16-bit PNG or TIFF, float TIFF, .npy) or mesh (.ply, .obj, .stl, .off, .glb) on disk.

        height_scale: length of one step of the map's values, in the unit of `spacing`; both are ignored for a mesh.
        An image's columns run along x and its rows along y; `.npy` is taken as `heights[i, j]` of `from_heights`.
        """
        from torchms.microsurface.surfaces.mesh import read_heights, read_mesh

        mesh = read_mesh(path)
        if mesh is not None:
            return Heightfield.from_mesh(mesh, periodic=periodic, level=level)
        if not (math.isfinite(height_scale) and height_scale > 0):
            raise ValueError(
                f"Heightfield.from_file(height_scale=...) must be finite and above 0; got {height_scale}. "
                "It is the height of one step of the map's values."
            )
        heights = checked_heights(read_heights(path), f"Heightfield.from_file: the heights of {path}")
        return Heightfield.from_heights(heights * height_scale, spacing, periodic=periodic, level=level)

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
            float(np.mean((_forward(self.heights, 0) / self.spacing[0]) ** 2)),
            float(np.mean((_forward(self.heights, 1) / self.spacing[1]) ** 2)),
        )

    @property
    def alpha(self) -> tuple[float, float]:
        """α_x, α_y that a Beckmann surface of the same slope variances has, √(2 · variance)."""
        vx, vy = self.slope_variance
        return (math.sqrt(2 * vx), math.sqrt(2 * vy))

    @cached_property
    def texel_slope_change(self) -> float:
        """rms change of slope between neighbouring facets along an axis, the larger of the two axes."""
        change = [_rms(_forward(_forward(self.heights, axis), axis)) / step for axis, step in enumerate(self.spacing)]
        return float(max(change))

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":
        """One tile as a triangle mesh, (n_x + 1)(n_y + 1) vertices; the last row and column repeat the first."""
        from torchms.microsurface.surfaces.mesh import mesh_of_grid

        return mesh_of_grid(np.pad(self.heights, ((0, 1), (0, 1)), mode="wrap"), self.spacing)

    def export(self, path: str | Path, *, force: bool = False) -> None:
        """Write the tile: .npy holds the heights, any other suffix (.ply, .obj, .stl, …) `mesh`, by trimesh.

        Atomic. Raises FileExistsError if `path` exists and not `force`.
        """
        from torchms.microsurface.surfaces.mesh import export

        export(self, path, force=force)

    def report(self, bins: int = 64) -> dict[str, Any]:
        """What the surface is like, JSON-serialisable.

        slope_variance, slope_covariance and alpha are measured. slope_distance: per axis, the total variation distance
        (0 … 1) between the histogram of the facets' slopes, in `bins` bins over ±4 rms, and the Beckmann one of
        the same variance (a Gaussian). heights: histogram over `bins` bins, with its moments.
        """
        sx, sy = (_forward(self.heights, axis) / step for axis, step in enumerate(self.spacing))
        h = self.heights - self.heights.mean()
        rms = _rms(h)
        counts, edges = np.histogram(h, bins=bins)
        unit = h / rms if rms > 0 else h
        # The two facets of a cell have slopes (sx_j, sy_i) and (sx_{j+1}, sy_{i+1}).
        covariance = 0.5 * np.mean(sx * sy) + 0.5 * np.mean(np.roll(sx, -1, 1) * np.roll(sy, -1, 0))
        return {
            "size": list(self.shape),
            "triangles": self.n_triangles,
            "spacing": list(self.spacing),
            "slope_variance": list(self.slope_variance),
            "slope_covariance": float(covariance),
            "alpha": list(self.alpha),
            "slope_distance": [_distance_to_gaussian(s, bins) for s in (sx, sy)],
            "texel_slope_change": self.texel_slope_change,
            "heights": {
                "rms": rms,
                "min": float(h.min()),
                "max": float(h.max()),
                "skewness": float(np.mean(unit**3)),
                "excess_kurtosis": float(np.mean(unit**4) - 3) if rms > 0 else 0.0,
                "edges": edges.tolist(),
                "share": (counts / h.size).tolist(),
            },
        }


@dataclass(frozen=True)
class GaussianSurfaces:
    """Recipe for `count` independent surfaces `Heightfield.gaussian(alpha, alpha_y, ...)`, seeded by the simulation."""

    alpha: float | int
    alpha_y: float | int | None = None
    count: int = 8
    size: int = 1024
    texels_per_correlation: float | int = 16.0

    def __post_init__(self) -> None:
        ax = checked_alpha(self.alpha, "GaussianSurfaces(alpha=...)")
        ay = ax if self.alpha_y is None else checked_alpha(self.alpha_y, "GaussianSurfaces(alpha_y=...)")
        if self.count < 1:
            raise ValueError(
                f"GaussianSurfaces(count=...) must be at least 1; got {self.count}. Standard errors need 2 or more."
            )
        check_resolution(max(ax, ay), self.size, self.texels_per_correlation)

    def surface(self, seed: int) -> Heightfield:
        """The surface of one seed."""
        return Heightfield.gaussian(
            self.alpha,
            self.alpha_y,
            size=self.size,
            texels_per_correlation=self.texels_per_correlation,
            seed=seed,
        )


def checked_alpha(alpha: float | int, name: str) -> float:
    """`alpha` if a surface can have it, or ValueError."""
    if not (math.isfinite(alpha) and 1e-3 <= alpha <= 2):
        raise ValueError(f"{name} must lie in [1e-3, 2]; got {alpha}. A mirror is the limit alpha -> 0.")
    return float(alpha)


def checked_heights(heights: np.ndarray, name: str) -> np.ndarray:
    """`heights` if they are a finite real array of at least 4 × 4, or ValueError."""
    if heights.ndim != 2 or min(heights.shape) < 4 or heights.dtype.kind not in "fiub":
        raise ValueError(
            f"{name} must be a real 2-D array of at least 4 x 4 texels; got shape {heights.shape}, dtype "
            f"{heights.dtype}. Pass one channel of the height map."
        )
    bad = ~np.isfinite(heights)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(
            f"{name} must be finite; got {heights[first]} at index {first} ({int(bad.sum())} of {heights.size} "
            "texels). Fill or crop the holes of the measurement first."
        )
    return heights


def checked_spacing(spacing: tuple[Length, Length], name: str) -> tuple[float, float]:
    """`spacing` as two floats if both are finite and positive, or ValueError."""
    if len(spacing) != 2 or not all(math.isfinite(step) and step > 0 for step in spacing):
        raise ValueError(
            f"{name} must be one or two finite lengths above 0; got {spacing}. It is the distance between texels."
        )
    return (float(spacing[0]), float(spacing[1]))


def check_resolution(alpha: float, size: int, texels_per_correlation: float | int) -> None:
    """Raise ValueError if `size` texels at this resolution cannot carry slopes of `alpha`; say what can."""
    # A facet must not turn by more than MAX_SLOPE_CHANGE against its neighbour. Measured: half of that again moves
    # E_1 … E_3 by less than 0.0015.
    least = max(4.0, SLOPE_CHANGE_PER_TEXEL * alpha / MAX_SLOPE_CHANGE)
    texels = math.ceil(least)
    if not (math.isfinite(texels_per_correlation) and texels_per_correlation >= least):
        raise ValueError(
            f"Heightfield.gaussian(texels_per_correlation=...) must be at least {least:.3g} to resolve alpha = "
            f"{alpha:g}; got {texels_per_correlation}. Use texels_per_correlation={texels} with "
            f"size={MIN_CORRELATIONS * texels} or more."
        )
    needed = math.ceil(MIN_CORRELATIONS * texels_per_correlation)
    if size < needed:
        raise ValueError(
            f"Heightfield.gaussian(size=...) must be at least {needed} texels, {MIN_CORRELATIONS} correlation lengths "
            f"of {texels_per_correlation:g} texels; got {size}. Use size={needed} or more."
        )


def _gaussian_correlated(size: int, length: float | int, seed: int) -> np.ndarray:
    """Periodic Gaussian noise with autocorrelation ∝ exp(−r²/length²), length in texels (spectral synthesis)."""
    noise = np.random.Generator(np.random.Philox(seed)).standard_normal((size, size))
    kx = 2 * math.pi * np.fft.fftfreq(size)
    ky = 2 * math.pi * np.fft.rfftfreq(size)
    # The power spectrum of exp(−r²/l²) is ∝ exp(−k² l²/4); amplitudes are its square root.
    spectrum = np.fft.rfft2(noise)
    spectrum *= np.exp(-(kx**2) * length**2 / 8)[:, None]
    spectrum *= np.exp(-(ky**2) * length**2 / 8)[None, :]
    spectrum[0, 0] = 0
    return np.fft.irfft2(spectrum, s=(size, size))


def _forward(h: np.ndarray, axis: int) -> np.ndarray:
    return np.roll(h, -1, axis) - h


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _plane(h: np.ndarray) -> np.ndarray:
    """Least-squares plane through `h`; on a full grid the two slopes decouple."""
    x, y = (np.arange(n) - (n - 1) / 2 for n in h.shape)
    return (x @ h.sum(1) / (h.shape[1] * (x @ x))) * x[:, None] + (h.sum(0) @ y / (h.shape[0] * (y @ y))) * y


def _distance_to_gaussian(slopes: np.ndarray, bins: int) -> float:
    rms = _rms(slopes)
    if rms == 0:
        return 1.0
    edges = np.linspace(-4, 4, bins + 1)
    share = np.histogram(slopes / rms, bins=edges)[0] / slopes.size
    cumulative = np.array([0.5 * (1 + math.erf(e / math.sqrt(2))) for e in edges])
    expected = np.diff(cumulative)
    outside = abs((1 - share.sum()) - (1 - expected.sum()))
    return float(0.5 * (np.abs(share - expected).sum() + outside))
