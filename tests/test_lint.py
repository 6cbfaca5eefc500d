"""What `make lint` asks for holds: the linter, the formatter and the type checker have nothing to say."""

import configparser
import re
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


def test_named_shapes_are_checked():
    """At run time, in every test: all modules that take shapes from `torchms.typing`, and nothing that does not."""
    settings = configparser.ConfigParser()
    settings.read(ROOT / "setup.cfg")
    (given,) = re.findall(r"--jaxtyping-packages=(\S+)", settings["tool:pytest"]["addopts"])
    *checked, checker = given.split(",")
    named = [path for path in (ROOT / "torchms").rglob("*.py") if "torchms.typing" in path.read_text()]
    assert checker == "beartype.beartype"
    assert checked == sorted(".".join(path.relative_to(ROOT).with_suffix("").parts) for path in named)
