"""`torchms simulate`: its JSON, its messages, and that `--help` loads nothing heavy."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from torchms.cli.options import SimulateOptions
from torchms.cli.simulate import run_simulate
from torchms.microsurface import Heightfield

SMALL = dict(rays=4000.0, surfaces=2, size=128, tracer="grid", progress=False)


def test_json_holds_what_was_promised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.json"
    lobes = tmp_path / "lobes.npz"
    returned = run_simulate(SimulateOptions(theta=1.1, alpha=0.6, seed=3, json=out, lobes=lobes, **SMALL))
    result = json.loads(out.read_text())
    assert result == json.loads(json.dumps(returned))
    for name in ("reflected", "transmitted", "reflected_stderr", "transmitted_stderr"):
        assert len(result[name]) == 16 and all(isinstance(v, float) for v in result[name])
    assert sum(result["reflected"]) + result["lost"] == pytest.approx(1, abs=1e-9)
    assert result["rays_per_second"] > 0 and result["segments_per_second"] > 0
    assert result["slopes"]["alpha"] == pytest.approx([0.6, 0.6])
    assert result["configuration"]["seed"] == 3 and result["configuration"]["surface"]["alpha"] == 0.6
    assert result["options"]["theta"] == 1.1
    with np.load(lobes, allow_pickle=False) as file:
        assert file["mean"].shape == file["stderr"].shape == (4, 64, 64, 1)
    assert "reflected" in capsys.readouterr().out


@pytest.mark.parametrize("material", ["conductor", "dielectric", "diffuse"])
def test_materials(material: str) -> None:
    result = run_simulate(SimulateOptions(material=material, **SMALL))
    out = sum(result["reflected"]) + sum(result["transmitted"])
    assert out + result["lost"] == pytest.approx(1, abs=1e-9)
    assert (sum(result["transmitted"]) > 0.5) == (material == "dielectric")


def test_metal_has_three_channels() -> None:
    result = run_simulate(SimulateOptions(metal="Cu", **SMALL))
    assert np.shape(result["reflected"]) == (16, 3)
    total = np.sum(result["reflected"], 0) + result["lost"] + np.array(result["absorbed"])
    assert total == pytest.approx([1, 1, 1], abs=1e-8)


def test_measured_surface(tmp_path: Path) -> None:
    path = tmp_path / "measured.npy"
    surface = Heightfield.gaussian(0.5, 0.2, size=128, seed=1)
    np.save(path, surface.heights)
    options = SMALL | dict(surface=path, spacing=surface.spacing[0], periodic=True)
    result = run_simulate(SimulateOptions(**options))
    assert result["slopes"]["alpha"][0] == pytest.approx(0.5, rel=1e-6)
    assert result["configuration"]["surface"]["kind"] == "Heightfield"


BAD = {
    "theta": (dict(theta=1.6), r"--theta must lie in \[0, pi/2\)"),
    "rays": (dict(rays=0.0), "--rays"),
    "metal": (dict(metal="Cu", material="diffuse"), "--metal"),
    "alpha": (dict(alpha=5.0), "alpha"),
    "folder": (dict(json=Path("no/such/folder/out.json")), "folder"),
    "file": (dict(surface=Path("nowhere.npy")), "no file"),
}


@pytest.mark.usefixtures("plain_messages")
@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_named(case: str) -> None:
    change, message = BAD[case]
    with pytest.raises((ValueError, OSError), match=message):
        run_simulate(SimulateOptions(**(SMALL | change)))


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    out.write_text("mine")
    with pytest.raises(FileExistsError, match="force"):
        run_simulate(SimulateOptions(json=out, **SMALL))
    assert out.read_text() == "mine"
    run_simulate(SimulateOptions(json=out, force=True, **SMALL))
    assert json.loads(out.read_text())["n"] == 4000


def test_options_load_nothing_heavy() -> None:
    heavy = "('torch', 'numpy', 'trimesh', 'numba')"
    code = f"import sys, torchms.cli.options; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize("own", [False, True])
def test_a_model_beside_the_surface(own: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In one call, by name or the expression's own: energies with standard errors and z, printed and written."""
    out = tmp_path / "out.json"
    which = dict(model="own", bsdf="RoughConductor(Beckmann(0.6), Ideal(), SingleBounce())") if own else {}
    words = dict(alpha="0.6", model="height-walk") | which
    if own:
        words.pop("alpha")
    run_simulate(SimulateOptions(theta=1.1, walks=4000, json=out, **SMALL, **words))
    result = json.loads(out.read_text())
    model = result["model"]
    assert model["n"] == 4000 and model["name"] == words["model"]
    orders = len(model["reflected"])
    assert orders == (1 if own else 16) and len(model["z"]["reflected"]) == orders
    error = (result["reflected_stderr"][0] ** 2 + model["reflected_stderr"][0][0] ** 2) ** 0.5
    z = (result["reflected"][0] - model["reflected"][0][0]) / error
    assert model["z"]["reflected"][0][0] == pytest.approx(z, abs=1e-5)
    # What the single bounce loses is seen; the height walk loses nothing to speak of.
    total = model["z"]["total"][0]
    assert total > 20 if own else abs(sum(x[0] for x in model["reflected"]) - 1) < 1e-4
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("R, T:") and any(line.split()[:2] == ["R", "1"] for line in lines)


@pytest.mark.usefixtures("plain_messages")
def test_a_model_that_does_not_hold_is_refused_before_anything_is_traced() -> None:
    for change, message in (
        (dict(model="own"), "--model own .* --bsdf"),
        (dict(model="invariance", material="dielectric"), "one side of the surface"),
        (dict(model="height-walk", walks=1), "--walks"),
    ):
        with pytest.raises(ValueError, match=message):
            run_simulate(SimulateOptions(**(SMALL | change)))
