"""`torchms export` and `python -m export`."""

import json
import subprocess
import sys
from pathlib import Path

import onnxruntime
import pytest

from torchms import GGX, GTR, Correlated, RoughConductor, Unidirectional
from torchms.cli.export import build, run_export
from torchms.cli.options import ExportOptions
from torchms.fresnel import Ideal
from torchms.onnx import Evaluator, export

ROOT = Path(__file__).parents[2]


def test_export_and_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, table = tmp_path / "cu.onnx", tmp_path / "cu.json"
    options = ExportOptions(
        str(path),
        metal="Cu",
        scattering="single-bounce",
        parameters=("alpha",),
        check=True,
        rows=5_000,
        json=str(table),
    )
    run_export(options)
    said = capsys.readouterr().out
    assert "rel p99.9" in said and "inputs wi, wo, alpha" in said and "| ok |" in said
    assert Evaluator(path).metadata["torchms.what"] == "forward"
    assert json.loads(table.read_text())["parity"]["misses"] == 0


def test_free_axes_have_names(tmp_path: Path) -> None:
    """A reader of the file, without torchms, sees which axis is the batch and which the paths."""
    surface = RoughConductor(GGX(0.3), Ideal(), Unidirectional(Correlated(), max_order=2))
    path = export(surface, tmp_path / "a.onnx", what="orders", parameters=("alpha",), n_paths=None)
    session = onnxruntime.InferenceSession(path)
    shapes = {each.name: each.shape for each in (*session.get_inputs(), *session.get_outputs())}
    direction = ["batch", 3]
    u = ["batch", "paths", surface.n_uniforms]
    assert shapes == {"wi": direction, "wo": direction, "u": u, "alpha": ["batch"], "orders": ["batch", 2, 1]}


@pytest.mark.parametrize(
    "change,words",
    [
        ({"material": "diffuse", "metal": "Cu"}, "--metal"),
        ({"json": "x.json"}, "--check"),
        ({"rows": 0}, "--rows"),
        ({"material": "dielectric", "scattering": "invariance"}, "one side"),
        ({"alpha": "rough"}, "--alpha"),
        ({"gamma": 2.0}, "--gamma"),
    ],
)
def test_options_that_do_not_fit(change: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=words):
        run_export(ExportOptions(str(tmp_path / "x.onnx"), **change))
    assert not list(tmp_path.iterdir())


def test_gtr_is_among_the_distributions() -> None:
    facets = build(ExportOptions("x.onnx", distribution="gtr", alpha="0.4", gamma=3.0, double=True)).distribution
    assert isinstance(facets, GTR) and (float(facets.alpha), float(facets.gamma)) == pytest.approx((0.4, 3.0))


def test_options_need_no_torch() -> None:
    code = "import sys, torchms.cli.options; sys.exit(int('torch' in sys.modules or 'onnx' in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


@pytest.mark.slow
def test_the_set(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "export", "--out", str(tmp_path), "--materials", "conductor", "--distributions"]
    command += ["ggx", "--scatterings", "single-bounce", "--what", "forward", "pdf", "--rows", "20000"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 files, 0 missed a bound." in result.stdout and len(list(tmp_path.glob("*.onnx"))) == 2
