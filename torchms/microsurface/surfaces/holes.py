"""Height maps as they come: holes, units that a file does not say, and texels too coarse for the surface."""

from pathlib import Path
from typing import Any

import numpy as np

from torchms.microsurface.surfaces.differences import rms
from torchms.microsurface.surfaces.scans import Scan
from torchms.slopes.heights import Spacing, checked_spacing


def filled(heights: Any) -> np.ndarray:
    """`heights` with their holes (NaN, infinities) interpolated linearly between the texels around each; as float64.

    A hole at the edge of the map takes the nearest height. Raises ValueError where nothing was measured at all.
    """
    from scipy.interpolate import griddata
    from scipy.ndimage import binary_dilation

    h = np.array(heights, dtype=np.float64)
    holes = ~np.isfinite(h)
    if holes.all():
        raise ValueError("filled(heights=...) must hold some finite heights; got none.")
    if holes.any():
        around = binary_dilation(holes, np.ones((3, 3), dtype=bool), iterations=2) & ~holes
        points, values, wanted = np.argwhere(around), h[around], np.argwhere(holes)
        nearest = griddata(points, values, wanted, "nearest")
        # Points on one line span no triangle.
        flat = len(points) < 4 or min(np.ptp(points, axis=0)) == 0
        linear = nearest if flat else griddata(points, values, wanted, "linear")
        h[holes] = np.where(np.isnan(linear), nearest, linear)
    return h


def units(
    scan: Scan, path: str | Path, spacing: Spacing | None, height_scale: float | int | None, name: str
) -> tuple[tuple[float, float], float]:
    """Spacing of a map and factor of its heights; ValueError for what neither file nor caller says, or both."""
    if height_scale is None and scan.steps:
        raise ValueError(
            f"{name}(height_scale=...) must be given: the heights of {path} are steps of a length that the file does not say. "
            "Pass it in the unit of the spacing."
        )
    if scan.spacing is not None and spacing is not None:
        raise ValueError(
            f"{name}(spacing=...) must be left out: {path} says that its texels are {scan.spacing[0]:g} x {scan.spacing[1]:g} "
            f"{scan.unit or ''} apart. Scale the slopes by height_scale."
        )
    given = spacing if scan.spacing is None else scan.spacing
    if given is None:
        raise ValueError(
            f"{name}(spacing=...) must be given: {path} does not say how far apart its texels are. Pass dx or (dx, dy) in the "
            "unit of the heights."
        )
    step = checked_spacing(given, f"{name}(spacing=...)")
    return step, 1.0 if height_scale is None else float(height_scale)


def check_resolved(heights: np.ndarray, spacing: tuple[float, float], name: str) -> None:
    """Raise ValueError if slopes change more from texel to texel than they differ at all: say the spacing that serves.

    Then neighbouring facets have nothing to do with each other: it is noise, or the surface between the texels was missed.
    """
    for axis, step in enumerate(spacing):
        slopes = np.diff(heights, axis=axis) / step
        spread = float(slopes.std())
        change = rms(np.diff(slopes, axis=axis))
        if spread > 0 and change > spread:
            raise ValueError(
                f"{name}: along {'xy'[axis]} the slope changes by {change:.3g} (rms) from texel to texel, more than the slopes "
                f"differ ({spread:.3g}): the map is too coarse for its slopes. Measure with a spacing of "
                f"{0.25 * step * spread / change:.3g} or less instead of {step:.3g}, or filter its noise and use "
                "Heightfield.from_heights."
            )
