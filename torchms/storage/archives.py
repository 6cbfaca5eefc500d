"""Arrays out of .npz and .npy files that nobody vouches for: no pickle, no array before its size is known to fit."""

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_arrays(path: str | Path, most_bytes: int) -> dict[str, NDArray]:
    """All arrays of the file, by name, if they hold no more than `most_bytes` together.

    Raises ValueError for whatever is wrong with it: truncated, damaged, too large, not of arrays of plain numbers.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            unpacked = sum(member.file_size for member in members)
            if unpacked > most_bytes:
                raise ValueError(f"it would unpack to {unpacked} bytes, {most_bytes} are expected at most")
            for member in members:
                with archive.open(member) as file:
                    _check_header(file, member.filename, member.file_size)
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen kinds for as many kinds of damage
        raise ValueError(str(error) or type(error).__name__) from error


def read_versioned(path: Path, most_bytes: int, version: int, what: str, remedy: str) -> dict[str, NDArray]:
    """As `read_arrays`, of a file of `what` that says which format it has.

    Raises FileNotFoundError for none, ValueError for one that is damaged or of another format; both say the `remedy`.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path} of {what}. {remedy}")
    try:
        arrays = read_arrays(path, most_bytes)
    except ValueError as error:
        raise ValueError(f"{path.name} is truncated or no .npz file of {what}: {error}. {remedy}") from error
    found = scalar(arrays, "format", f"{path.name} is no file of {what}", remedy)
    if found != version:
        raise ValueError(f"{path.name} is no file of {what} of format {version}, but of format {found}. {remedy}")
    return arrays


def read_array(path: str | Path, most_bytes: int) -> NDArray:
    """The array of a .npy file of no more than `most_bytes`; ValueError for whatever is wrong with it."""
    try:
        size = Path(path).stat().st_size
        if size > most_bytes:
            raise ValueError(f"it is of {size} bytes, {most_bytes} are expected at most")
        with open(path, "rb") as file:
            _check_header(file, "it", size)
        return np.asarray(np.load(path, allow_pickle=False))
    except Exception as error:
        raise ValueError(str(error) or type(error).__name__) from error


def scalar(arrays: Mapping[str, NDArray], name: str, otherwise: str, remedy: str) -> Any:
    """The number or the text `name`; ValueError, which begins with `otherwise`, if the file does not say it."""
    if name not in arrays or arrays[name].shape != ():
        raise ValueError(f"{otherwise}: it does not say its {name}. {remedy}")
    return arrays[name].item()


def single(array: NDArray, name: str, file: str, remedy: str) -> NDArray:
    """The array itself if it is float32; ValueError otherwise."""
    if array.dtype != np.float32:
        raise ValueError(f"{file}: {name!r} must be float32; got {array.dtype}. {remedy}")
    return array


def _check_header(file: Any, name: str, size: int) -> None:
    """Raise ValueError unless the file is an array of plain numbers of just this `size` [bytes]."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"{name} is an array file of version {version}")
    shape, _, dtype = read[version](file)
    if dtype.hasobject:
        raise ValueError(f"{name} holds objects, which would have to be unpickled")
    if math.prod(shape) * dtype.itemsize != size - file.tell():
        raise ValueError(f"{name} says that it is {shape} of {dtype}, which is not its size")
