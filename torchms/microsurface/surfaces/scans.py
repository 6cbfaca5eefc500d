"""Scans of real surfaces: x3p, profilometers' text and the like, through SurfaceTopography."""

import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from torchms.extras import missing
from torchms.storage.media import MOST_PIXELS

TEXT = (".asc", ".txt", ".xyz")
SCANS = (*TEXT, ".al3d", ".gwy", ".opd", ".plu", ".plux", ".sdf", ".sur", ".x3p")
"""Suffixes: matrices or points as text; what is read of others is SurfaceTopography's default channel."""
MOST_BYTES = 16 * MOST_PIXELS
MOST_TEXT = 1 << 29


class Scan(NamedTuple):
    """Heights (n_x, n_y), NaN where nothing was measured, and what the file says of the distance between its texels."""

    heights: np.ndarray
    spacing: tuple[float, float] | None = None
    """In the unit of the heights; None if the file does not say it."""
    unit: str | None = None
    steps: bool = False
    """Whether heights are whole steps of a length that the file does not say."""


def read_scan(path: str | Path) -> Scan:
    """The height map in a scan's file, in the unit that the file has along x.

    Raises ValueError for one that is damaged, too large (before anything of that size is made) or no map; ImportError
    without SurfaceTopography.
    """
    path = Path(path)
    try:
        from SurfaceTopography import open_topography
    except ImportError as error:
        raise missing(f"{path}", "SurfaceTopography") from error
    _check_size(path)
    heights, spacing, unit = np.empty((0, 0)), None, None
    try:
        channel = open_topography(str(path)).default_channel
        points = tuple(int(n) for n in channel.nb_grid_pts)
        if len(points) == 2 and 0 < points[0] * points[1] <= MOST_PIXELS:
            known = channel.physical_sizes is not None
            topography = channel.topography(**({} if known else {"physical_sizes": points}))
            heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan)
            dx, dy = (float(step) for step in topography.pixel_size)
            spacing = (dx, dy) if known else None
            unit = topography.unit
    except Exception as error:  # the library raises a dozen kinds for as many formats and kinds of damage
        told = (str(error).strip() or type(error).__name__).splitlines()[0]
        told = "no known format of heights" if told.startswith("tried ") else told
        raise ValueError(f"the scan {path} cannot be read: {told}. Export it again, as .x3p.") from error
    if len(points) != 2:
        raise ValueError(f"the scan {path} is a line of {points[0]} heights, no map. Measure an area.")
    if not 0 < points[0] * points[1] <= MOST_PIXELS:
        raise ValueError(
            f"the scan {path} says that it is {points[0]} x {points[1]} texels; at most {MOST_PIXELS} are read. Crop it."
        )
    return Scan(heights, spacing, unit)


def _check_size(path: Path) -> None:
    """Raise ValueError for a file that is too large, packed or not."""
    most = MOST_TEXT if path.suffix.lower() in TEXT else MOST_BYTES
    size = path.stat().st_size
    if zipfile.is_zipfile(path):
        try:
            with zipfile.ZipFile(path) as archive:
                size = max(size, sum(member.file_size for member in archive.infolist()))
        except Exception as error:
            raise ValueError(f"the scan {path} cannot be read: {error}. Export it again, as .x3p.") from error
    if size > most:
        raise ValueError(f"the scan {path} is of {size} bytes; at most {most} are read. Crop it.")
