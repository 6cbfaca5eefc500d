"""What `make lint` asks for holds: the linter, the formatter and the type checker have nothing to say."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CHECKS = {
    "ruff": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["pyright", "--pythonpath", sys.executable, "torchms"],
    "scripts": ["pyright", "--pythonpath", sys.executable, "benchmarks", "examples", "export", "tools"],
    "tests": ["pyright", "--pythonpath", sys.executable, "tests"],
}
SLOW = ("scripts", "tests")
"""They look at what the library does without."""


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in CHECKS])
def test_clean(name):
    done = subprocess.run(
        [sys.executable, "-m", *CHECKS[name]], cwd=ROOT, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, f"make lint: {name}\n{done.stdout[-4000:]}{done.stderr[-2000:]}"
