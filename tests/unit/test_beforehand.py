"""What a command line says before torch is loaded."""

import subprocess
import sys
from pathlib import Path

import pytest

from torchms import cli
from torchms.cli.beforehand import CHECKS
from torchms.cli.commands import COMMANDS

REFUSED = {
    "index of a metal": ("energy --eta 0", "--eta goes with --material dielectric"),
    "albedo of a metal": ("simulate --albedo 0.5", "--albedo goes with --material diffuse"),
    "metal of glass": ("render sphere --out {out}/a.png --material dielectric --metal Au", "--metal goes with"),
    "twice": ("energy --bsdf RoughConductor(GGX(0.3),Ideal()) --alpha 0.3", "--bsdf says all of the surface"),
    "orders twice": (
        "energy --bsdf RoughConductor(GGX(0.3),Ideal()) --max-order 3",
        "--max-order would change nothing",
    ),
    "orders of one": (
        "export {out}/a.onnx --scattering single-bounce --max-order 3",
        "--max-order would change nothing",
    ),
    "suffix": ("export {out}/c.txt", "must end in .onnx"),
    "comparison": ("export {out}/c.onnx --rows 10", "--rows would change nothing"),
    "walks": ("simulate --walks 1e3", "--walks would change nothing"),
    "texels": ("simulate --spacing 2", "--spacing would change nothing"),
    "direction": ("render sphere --out {out}/a.png --light constant --towards-light 0 0 1", "--towards-light would"),
    "sampling": ("render sphere --out {out}/a.png --sampling bsdf", "--sampling would change nothing"),
    "tone": ("render sphere --out {out}/a.exr --tone filmic", "--tone would change nothing"),
    "inside of a metal": ("render sphere --out {out}/a.png --inner 3", "--inner would change nothing"),
    "crease": ("render sphere --out {out}/a.png --crease 10", "--crease would change nothing"),
    "picture of a fit": ("fit-measured {out}/a.bsdf --out {out}/a.jpg", "must end in .png"),
    "no file": ("fit-measured {out}/a.bsdf", "there is no file"),
    "folder": ("lut --out {out}", "is a folder"),
    "no folder": ("energy --json {out}/none/a.json", "does not exist"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line, said = REFUSED[name]
    assert cli.main(line.replace("{out}", str(tmp_path)).split()) == 2
    assert said in capsys.readouterr().err and not list(tmp_path.iterdir())


MISSING = {
    "onnx": "export {out}/a.onnx",
    "numba": "simulate --tracer grid",
    "embreex": "simulate",
    "matplotlib": "figures --out {out}/f",
    "PIL": "render sphere --out {out}/a.png",
    "OpenEXR": "render sphere --out {out}/a.exr",
}


@pytest.mark.parametrize("module", MISSING)
def test_a_missing_extra_is_named_with_its_line(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert cli.main(MISSING[module].replace("{out}", str(tmp_path)).split()) == 2
    assert 'pip install "torchms[' in capsys.readouterr().err


def test_it_does_not_load_torch(tmp_path: Path) -> None:
    """Which takes most of a second, and more on a busy machine."""
    lines = [line.replace("{out}", str(tmp_path)).split() for line, _ in REFUSED.values()]
    program = f"""if True:
        import sys
        from torchms.cli import main
        for line in {lines!r}:
            assert main(line) == 2, line
            loaded = {{"torch", "numpy", "onnx", "numba"}} & set(sys.modules)
            assert not loaded, (line, loaded)
    """
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_every_command_with_files_is_checked() -> None:
    assert {options for options, _ in COMMANDS.values()} - {*CHECKS} == {COMMANDS["lab"][0]}
