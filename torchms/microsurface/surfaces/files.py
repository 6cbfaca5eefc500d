"""Height maps and meshes on disk: 16-bit images, .npy, scans, and what trimesh reads and writes."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from torchms.microsurface.surfaces.scans import SCANS, Scan, read_scan
from torchms.storage import media
from torchms.storage.archives import read_array
from torchms.storage.media import MESHES, MOST_PIXELS, read_image

if TYPE_CHECKING:
    import trimesh

IMAGE_SUFFIXES = (".png", ".tif", ".tiff")


def read_mesh(path: str | Path) -> "trimesh.Trimesh | None":
    """The mesh at `path`, or None if its suffix is not a mesh's."""
    _check_readable(path)
    if Path(path).suffix.lower() not in MESHES:
        return None
    return media.read_mesh(path)


def read_heights(path: str | Path) -> Scan:
    """Heights in .npy, in a 16-bit or float PNG/TIFF, or of a scan; an image's columns become the first axis (x)."""
    _check_readable(path)
    suffix = Path(path).suffix.lower()
    if suffix in SCANS:
        return read_scan(path)
    if suffix == ".npy":
        try:
            return Scan(read_array(path, 16 * MOST_PIXELS))
        except ValueError as error:
            raise ValueError(f"Heightfield.from_file(path=...): {path} is not a plain .npy array ({error}).") from error
    if suffix not in IMAGE_SUFFIXES:
        allowed = ", ".join((".npy", *IMAGE_SUFFIXES, *SCANS, *MESHES))
        raise ValueError(f"Heightfield.from_file(path=...) must end in one of {allowed}; got {path}. Convert it first.")
    image = read_image(path, ("PNG", "TIFF"))
    if image.mode not in ("I;16", "I;16B", "I;16L", "I", "F"):
        raise ValueError(
            f"Heightfield.from_file(path=...) must be a 16-bit (or float) height map of one channel; {path} has "
            f"mode {image.mode}. 256 steps of height make terraces: export the measurement with 16 bits."
        )
    return Scan(np.array(image).astype(np.float64).T, steps=image.mode != "F")


def encoded(path: Path, heights: np.ndarray, mesh: "Callable[[], trimesh.Trimesh]") -> bytes:
    """The content of a file of `path`'s suffix: .npy holds the heights, the others the mesh."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        buffer = io.BytesIO()
        np.save(buffer, heights)
        return buffer.getvalue()
    if suffix in MESHES:
        data = mesh().export(file_type=suffix[1:])
        assert isinstance(data, str | bytes)
        return data.encode() if isinstance(data, str) else data
    allowed = ", ".join((".npy", *MESHES))
    raise ValueError(f"Heightfield.export(path=...) must end in one of {allowed}; got {path}.")


def _check_readable(path: str | Path) -> None:
    if not Path(path).is_file():
        raise FileNotFoundError(f"Heightfield.from_file(path=...): there is no file {path}.")
