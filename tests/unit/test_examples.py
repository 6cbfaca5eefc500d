"""The examples run, on a small scale."""

import subprocess
import sys
from pathlib import Path

import pytest

from torchms.mitsuba import find_llvm

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run(name: str, *options: str) -> str:
    """What `examples/name.py` prints."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_gbuffer_fit(tmp_path):
    """All bounces come nearer to the maps than one does."""
    out = tmp_path / "fit.png"
    lines = run("gbuffer_fit", "--size", "12", "--steps", "120", "--out", str(out)).splitlines()
    errors = {line.split()[0]: [float(x) for x in line.split()[2:6]] for line in lines if " bounces " in line}
    assert out.stat().st_size > 1000
    assert all(a < b for a, b in zip(errors["all"], errors["one"], strict=True)), lines


@pytest.mark.slow
def test_relight(tmp_path):
    """One bounce loses light of rough metal."""
    out = tmp_path / "relit.png"
    lines = run("relight", "--size", "16", "--samples", "8", "--out", str(out)).splitlines()
    (rough,) = [line for line in lines if line.startswith("rough metal")]
    assert -60 < float(rough.split("has ")[1].split()[0]) < -15 and out.stat().st_size > 500


@pytest.mark.slow
def test_learned_material(tmp_path):
    out = tmp_path / "learned.png"
    text = run("learned_material", "--size", "16", "--steps", "150", "--batch", "512", "--out", str(out))
    error = float(text.split("mean relative error ")[1].split()[0])
    assert error < 25 and out.stat().st_size > 500


@pytest.mark.slow
def test_lobes(tmp_path):
    """The rougher, the more light bounces again."""
    out = tmp_path / "lobes.png"
    lines = run("lobes", "--paths", "16", "--out", str(out)).splitlines()
    smooth, rough = (float(line.split("; ")[1].split()[0]) for line in lines)
    assert 5 < smooth < 25 and 35 < rough < 60 and out.stat().st_size > 10_000


@pytest.mark.slow
def test_mitsuba_inverse(tmp_path):
    """The fit runs and writes its maps; how near it comes is a question of steps that a test has no time for."""
    pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")
    if find_llvm() is None:
        pytest.skip("needs an LLVM of version 17 or later (Debian: libllvm19)")
    out, small = tmp_path / "maps.png", ("--size", "24", "--texels", "8", "--views", "2", "--spp", "8", "--steps", "20")
    lines = run("mitsuba_inverse", *small, "--out", str(out)).splitlines()
    errors = [float(x) for line in lines for x in line.replace(",", "").split() if x.startswith("0.")]
    assert len(errors) == 4 and all(error < 0.3 for error in errors) and out.stat().st_size > 200


@pytest.mark.slow
def test_scan(tmp_path):
    """Smith's model is within a few hundredths of the rays on the ground, at every angle and order."""
    out = tmp_path / "scan.png"
    lines = run("scan", "--rays", "60000", "--components", "8", "--out", str(out)).splitlines()
    energies = {
        tuple(line.split()[1:3]): [float(x) for x in line.split()[3::3]] for line in lines if line.startswith("theta")
    }
    assert len(energies) == 9 and out.stat().st_size > 1000
    for theta in ("0.0", "0.8", "1.3"):
        for a, b in zip(energies[theta, "Tabulated"], energies[theta, "rays"], strict=True):
            assert abs(a - b) < 0.04, lines
