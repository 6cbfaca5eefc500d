"""Results on disk: written whole or not at all, and never over something else without being told."""

import errno
import glob
import json
import os
import secrets
from contextlib import suppress
from fnmatch import fnmatch
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # not on Windows: what a killed process leaves there stays until somebody removes it
    fcntl = None


def check_writable(path: str | Path, force: bool) -> Path:
    """`path`, if a file may be put there. To be called before the work whose result goes there.

    Raises FileExistsError if it exists and `force` is not set, IsADirectoryError if it is a folder, FileNotFoundError if
    its folder does not exist, PermissionError if no file can be made there: one is tried.
    """
    path = _allowed(Path(path), force)
    probe = _temporary(path)
    try:
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        probe.open("xb").close()
    except OSError as error:
        raise PermissionError(
            f"the folder {path.parent} of {path.name} cannot be written: {error.strerror}."
        ) from error
    finally:
        probe.unlink(missing_ok=True)
    return path


def _allowed(path: Path, force: bool) -> Path:
    """`path`, unless something is in the way."""
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder. Name a file in it.")
    if path.exists() and not force:
        raise FileExistsError(f"{path} exists already. Choose another name, or overwrite it with force (--force).")
    folder = path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"the folder {folder} of {path.name} does not exist. Make it first.")
    return path


def write_whole(path: str | Path, content: bytes, force: bool = False, *, sweep: bool = True) -> None:
    """Put `content` at `path` in one step: a temporary file in the same folder, then a rename.

    What killed processes left of that temporary file is removed first, unless not to `sweep` (it reads the folder).
    """
    path = _allowed(Path(path), force)
    if sweep:
        remove_leftovers(path.parent, glob.escape(path.name))
    while not _written(path, content):
        pass


def remove_leftovers(folder: Path, names: str) -> int:
    """Remove what killed processes left half written in `folder` of files that match `names`, and count it.

    Whoever writes holds a lock, which the system takes back when he dies: a file that can be locked is nobody's.
    """
    found = 0
    with suppress(OSError):  # a folder may be writable and yet not readable
        for entry in list(os.scandir(folder)):
            if fnmatch(entry.name, f".{names}.????????.part") and entry.is_file(follow_symlinks=False):
                with suppress(OSError), open(entry.path, "rb+") as file:  # finished meanwhile, or another user's
                    if _locked(file, wait=False):
                        os.unlink(entry.path)
                        found += 1
    return found


def read_json(path: str | Path, most_bytes: int = 1 << 24) -> Any:
    """What the JSON file holds; ValueError if it is none or larger than `most_bytes`."""
    path = Path(path)
    if (size := path.stat().st_size) > most_bytes:
        raise ValueError(f"it is of {size} bytes, {most_bytes} are expected at most")
    try:
        return json.loads(path.read_bytes())
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _temporary(path: Path) -> Path:
    """A name in the same folder that nobody else has drawn."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")


def _written(path: Path, content: bytes) -> bool:
    """Put `content` at `path`; False if the temporary file is somebody else's, or he took it for a leftover."""
    # Named before it is made, so that an interrupt at any point finds what to remove.
    temporary = _temporary(path)
    try:
        with open(temporary, "xb") as file:
            _locked(file, wait=True)
            if not os.fstat(file.fileno()).st_nlink:
                return False
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            os.replace(temporary, path)
    except FileExistsError:  # another writer drew the same name: it is his
        return False
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return True


def _locked(file: IO[bytes], wait: bool) -> bool:
    """Whether this process now holds the lock of `file`. Where there are no locks nobody gets one."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def write_json(path: str | Path, value: Any, force: bool = False) -> None:
    """`value` as indented JSON at `path`, whole or not at all; NaN and infinity are refused."""
    write_whole(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode(), force)
