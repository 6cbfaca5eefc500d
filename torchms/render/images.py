"""Pictures on disk: linear EXR, and PNG in sRGB."""

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.extras import missing
from torchms.storage.media import MOST_PIXELS, check_pixels, read_image
from torchms.storage.write import check_writable, write_whole

SUFFIXES = (".exr", ".png")

FORMATS = ("PNG", "JPEG", "TIFF", "WEBP", "BMP")
"""What is read besides .exr, by Pillow."""


def check_picture(path: str | Path, force: bool) -> Path:
    """`path`, if a picture may be written there; to be called before the work.

    Raises ValueError for another suffix, ImportError if what writes this one is missing, see `check_writable` for the rest.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path} must end in {' or '.join(SUFFIXES)}: PNG is tone-mapped, EXR is linear.")
    _openexr() if suffix == ".exr" else _pillow()
    return check_writable(path, force)


def srgb(linear: Tensor) -> Tensor:
    """sRGB values in [0, 1] of linear ones, clipped [IEC 61966-2-1]."""
    x = linear.clamp(0, 1)
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def linear(encoded: Tensor) -> Tensor:
    """The inverse of `srgb`."""
    x = encoded.clamp(0, 1)
    return torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def filmic(x: Tensor) -> Tensor:
    """A curve that rolls highlights off, linear in and out; the fit to the ACES reference of Narkowicz (2015)."""
    x = 0.6 * x.clamp_min(0)
    return (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0, 1)


def write_picture(
    path: str | Path, pixels: Tensor, *, exposure: float = 0.0, tone: str = "srgb", force: bool = False
) -> None:
    """`pixels` (rows, columns, 3), linear, at `path`, whole or not at all.

    .exr: as they are, in float32. .png: times 2^exposure, through the `tone` curve ("srgb" clips, "filmic" rolls
    off), 8 bits.
    """
    path = check_picture(path, force)
    if path.suffix.lower() == ".exr":
        write_whole(path, exr_bytes(pixels), force)
        return
    exposed = pixels.double() * 2.0**exposure
    encoded = srgb(filmic(exposed) if tone == "filmic" else exposed)
    content = io.BytesIO()
    _pillow().fromarray((encoded * 255).round().to(torch.uint8).numpy()).save(content, "PNG", optimize=True)
    write_whole(path, content.getvalue(), force)


def exr_bytes(pixels: Tensor) -> bytes:
    """An OpenEXR file with the channels R, G and B in float32."""
    OpenEXR = _openexr()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "picture.exr")
        values = pixels.float().contiguous().numpy()
        try:
            with OpenEXR.File(header, {"RGB": values}) as file:
                file.write(name)
            with OpenEXR.File(name) as file:  # the library does not say that a disk was full: it writes what fits
                whole = np.array_equal(file.channels()["RGB"].pixels, values, equal_nan=True)
        except (RuntimeError, LookupError):
            whole = False
        if not whole:
            raise OSError(
                f"an .exr of {values.nbytes} bytes could not be made in {tempfile.gettempdir()}. Make room there."
            )
        return Path(name).read_bytes()


def read_picture(path: str | Path) -> Tensor:
    """The linear pixels (rows, columns, 3) of an .exr or an sRGB image file (PNG, JPEG, TIFF, WebP, BMP), float32.

    Raises ValueError for a file that is not there, cannot be read or is too large (`torchms.storage.media`).
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"the picture {path} does not exist.")
    if path.suffix.lower() != ".exr":
        image = read_image(path, FORMATS)
        from PIL.ImageOps import exif_transpose

        rgb = exif_transpose(image).convert("RGB")
        encoded = torch.frombuffer(bytearray(rgb.tobytes()), dtype=torch.uint8)
        return linear(encoded.reshape(rgb.height, rgb.width, 3).float() / 255)
    OpenEXR = _openexr()
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            _check_exr(path, [part.header for part in file.parts])
        with OpenEXR.File(str(path)) as file:
            channels = {name: torch.from_numpy(c.pixels.astype("float32")) for name, c in file.channels().items()}
    except Exception as error:
        raise ValueError(f"the picture {path} cannot be read: {error}") from error
    for name in ("RGB", "RGBA"):
        if name in channels:
            return channels[name][..., :3].contiguous()
    if "Y" in channels:
        return channels["Y"][..., None].expand(-1, -1, 3).contiguous()
    raise ValueError(f"the picture {path} has no channels R, G and B; it has {', '.join(channels)}.")


def _check_exr(path: Path, headers: list[dict[str, Any]]) -> None:
    """Raise ValueError if the parts of an .exr file are too large, each or together."""
    numbers = 0
    for header in headers:
        (left, top), (right, bottom) = header["dataWindow"]
        width, height = int(right) - int(left) + 1, int(bottom) - int(top) + 1
        check_pixels(path, width, height)
        numbers += width * height * len(header["channels"])
    if numbers > 4 * MOST_PIXELS:
        raise ValueError(f"it holds {numbers} numbers; at most {4 * MOST_PIXELS} are read")


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError as error:
        raise missing("a .png file", "Pillow") from error
    return Image


def _openexr() -> Any:
    try:
        import OpenEXR
    except ImportError as error:
        raise missing("an .exr file", "OpenEXR") from error
    return OpenEXR
