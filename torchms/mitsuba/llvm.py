"""Mitsuba's `llvm` variants need a libLLVM: one that Dr.Jit works with, not the first that lies about."""

import os
import re
from pathlib import Path

OLDEST = 17
"""Dr.Jit 1.5 aborts the process in LLVM 14 to 16."""
FOLDERS = (
    "/usr/lib/*-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/lib/llvm-*/lib",
    "/opt/homebrew/opt/llvm/lib",
    "/usr/local/lib",
)
NAME = re.compile(r"libLLVM(?:[-.]so)?[-.](\d+)(?:\.\d+)*(?:\.so|\.dylib)?(?:\.\d+)*$")


def find_llvm() -> Path | None:
    """The libLLVM that variants such as llvm_ad_rgb will load; None if there is none.

    It is that of DRJIT_LIBLLVM_PATH, else the newest of version 17 or later in the usual folders, which is then put into that
    variable. To be called before the first such variant is set: Dr.Jit looks once. Debian has it as the package libllvm19.
    """
    given = os.environ.get("DRJIT_LIBLLVM_PATH")
    if given:
        return Path(given) if Path(given).is_file() else None
    found: list[tuple[int, Path]] = []
    for pattern in FOLDERS:
        for path in Path("/").glob(f"{pattern[1:]}/libLLVM*"):
            match = NAME.fullmatch(path.name)
            if match and int(match[1]) >= OLDEST:
                found.append((int(match[1]), path))
    if not found:
        return None
    path = max(found)[1]
    os.environ["DRJIT_LIBLLVM_PATH"] = str(path)
    return path
