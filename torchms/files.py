"""Results on disk: written whole or not at all, and never over something else without being told."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any


def check_writable(path: str | Path, force: bool) -> Path:
    """`path`, if a file may be put there. To be called before the work whose result goes there.

    Raises FileExistsError if it exists and `force` is not set, FileNotFoundError if its folder does not exist,
    PermissionError if the folder cannot be written.
    """
    path = Path(path)
    if path.exists() and not force:
        raise FileExistsError(f"{path} exists already. Choose another name, or overwrite it with force (--force).")
    folder = path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"the folder {folder} of {path.name} does not exist. Make it first.")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"the folder {folder} of {path.name} cannot be written.")
    return path


def write_whole(path: str | Path, content: bytes, force: bool = False) -> None:
    """Put `content` at `path` in one step: a temporary file in the same folder, then a rename."""
    path = check_writable(path, force)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_json(path: str | Path, value: Any, force: bool = False) -> None:
    """`value` as indented JSON at `path`, whole or not at all; NaN and infinity are refused."""
    write_whole(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode(), force)
