"""C++ into machine code: the compiler, and a cache of what it made on disk."""

import atexit
import ctypes
import hashlib
import os
import platform
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import torch

FLAGS = ("-std=c++17", "-O2", "-fPIC", "-shared", "-w", "-fno-math-errno", "-fno-trapping-math")
SCHEDULED = ("-fschedule-insns", "-fsched-pressure")
"""For g++: a loop body of hundreds of operations waits for its own results unless they are put in another order."""


@cache
def missing_compiler() -> str:
    """Why there is no C++ compiler; empty if there is one."""
    try:
        _compiler()
    except Exception as error:
        return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return ""


@cache
def _compiler() -> str:
    """The C++ compiler that torch takes, the one in the variable CXX if there is one."""
    from torch._inductor.cpp_builder import get_cpp_compiler

    found = get_cpp_compiler()
    if Path(found).stem == "cl":
        raise RuntimeError("it needs the vector types of g++ or clang++")
    return found


@cache
def _processor() -> str:
    """What the machine code is made for."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        return f"{platform.machine()} {platform.processor()}"


@cache
def _command() -> tuple[str, ...]:
    native = "-mcpu=native" if platform.machine() in ("arm64", "aarch64") else "-march=native"
    # The functions of Sleef are those of torch.
    library = Path(torch.__file__).parent / "lib"
    undefined = ("-undefined", "dynamic_lookup") if sys.platform == "darwin" else ()
    scheduled = () if "clang" in Path(_compiler()).name else SCHEDULED
    return _compiler(), *FLAGS, *scheduled, native, f"-L{library}", *undefined


def folder() -> Path:
    """Where machine code is kept between processes; for this one only, where others could put theirs in its place."""
    from torch._inductor.runtime.cache_dir_utils import cache_dir

    kept = Path(cache_dir()) / "torchms"
    kept.mkdir(mode=0o700, parents=True, exist_ok=True)
    return kept if is_private(kept) else _temporary()


def is_private(path: Path) -> bool:
    """Whether only this user may write in the folder; code is loaded from no other."""
    state = path.stat()
    return not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o022)


@cache
def _temporary() -> Path:
    place = tempfile.TemporaryDirectory(prefix="torchms-")
    atexit.register(place.cleanup)
    return Path(place.name)


def built(source: str, exact: bool) -> ctypes.CDLL:
    """The library that is made of `source`; products and sums are rounded apart if `exact`.

    Raises RuntimeError, with the compiler's words, if it cannot be made.
    """
    command = (*_command(), f"-ffp-contract={'off' if exact else 'fast'}")
    key = hashlib.sha256("\0".join((*command, _processor(), torch.__version__, source)).encode()).hexdigest()[:32]
    path = folder() / f"{key}.so"
    if path.exists():
        try:
            return ctypes.CDLL(str(path))
        except OSError:
            pass  # cut short by a full disk, or of another system
    with tempfile.TemporaryDirectory(dir=path.parent) as place:
        text, library = Path(place) / "program.cpp", Path(place) / "program.so"
        text.write_text(source)
        done = subprocess.run(
            [*command, str(text), "-o", str(library), "-ltorch_cpu"], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"{command[0]} cannot compile a program of torchms: {done.stderr[-2000:]}")
        os.replace(library, path)
    return ctypes.CDLL(str(path))
