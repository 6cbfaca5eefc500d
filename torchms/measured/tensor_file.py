"""Arrays out of a `tensor_file`, the container of the RGL material database: no array before it is known to fit.

Little endian: the 12 bytes "tensor_file\\0", two bytes of version, the number of fields (uint32); then for each field the
length of its name (uint16), the name, its dimensions (uint16), its type (uint8), where it starts (uint64), its shape (uint64
each). Source: the files themselves, rgl.epfl.ch/materials, and [DupuyJakob2018].
"""

import math
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MAGIC = b"tensor_file\0"
VERSION = (1, 0)
MOST_BYTES = 1 << 30
"""Size of a file; the largest of the database, spectral and anisotropic, are a third of it."""
MOST_FIELDS, MOST_AXES = 64, 8
TYPES = dict(enumerate(("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8"), start=1))
"""Number in the file → type of an element."""


def read_tensor_file(path: str | Path) -> dict[str, NDArray]:
    """All fields of the file, by name, read only.

    Raises ValueError, which names the file and the field, for whatever is wrong with it: another kind or version, truncated,
    too large, a field that reaches beyond the file, of an unknown type, or there twice. FileNotFoundError where there
    is none.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}. Files of measured surfaces are at rgl.epfl.ch/materials.")
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path.name} is of {size} bytes; a tensor_file is of {MOST_BYTES} at most.")
    content = path.read_bytes()
    try:
        return _fields(content)
    except (ValueError, struct.error) as error:
        raise ValueError(
            f"{path.name} is no tensor_file, or a damaged one: {error}. The originals are at rgl.epfl.ch/materials."
        ) from error


def _fields(content: bytes) -> dict[str, NDArray]:
    if content[: len(MAGIC)] != MAGIC:
        raise ValueError("it does not start with its name")
    at = len(MAGIC)
    *version, count = struct.unpack_from("<BBI", content, at)
    at += 6
    if tuple(version) != VERSION:
        raise ValueError(f"it is of version {version[0]}.{version[1]}, not 1.0")
    if count > MOST_FIELDS:
        raise ValueError(f"it says that it has {count} fields; {MOST_FIELDS} are expected at most")
    found: dict[str, tuple[int, tuple[int, ...], np.dtype]] = {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", content, at)
        name = content[at + 2 : at + 2 + length].decode("utf-8")
        axes, kind, start = struct.unpack_from("<HBQ", content, at + 2 + length)
        at += 2 + length + 11
        if axes > MOST_AXES or kind not in TYPES:
            raise ValueError(
                f"field {name!r} has {axes} axes of type {kind}; up to {MOST_AXES} of types 1 to 11 are known"
            )
        shape = struct.unpack_from(f"<{axes}Q", content, at)
        at += 8 * axes
        if name in found:
            raise ValueError(f"field {name!r} is there twice")
        found[name] = start, shape, np.dtype(TYPES[kind])
    arrays = {}
    for name, (start, shape, dtype) in found.items():
        n = math.prod(shape)
        if start < at or start + n * dtype.itemsize > len(content):
            raise ValueError(
                f"field {name!r}, {shape} of {dtype} at byte {start}, is not inside its {len(content)} bytes"
            )
        arrays[name] = np.frombuffer(content, dtype, n, start).reshape(shape)
    return arrays
