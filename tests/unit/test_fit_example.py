"""The inverse-rendering example runs, on a small scale."""

import subprocess
import sys
from pathlib import Path

import pytest

FIT = Path(__file__).resolve().parents[2] / "benchmarks" / "fit.py"


@pytest.mark.slow
def test_quick_fit_runs():
    """A few steps on a small picture: a table with both materials and both models, and nothing is written."""
    done = subprocess.run(
        [sys.executable, str(FIT), "--quick", "--size", "16"], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    for word in ("gold", "glass", "single"):
        assert word in done.stdout
    assert "fit.png" not in done.stdout
