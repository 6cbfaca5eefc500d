"""Fits to measured surfaces: they find what is known, say how well, and what all bounces are worth."""

import json
import math
from pathlib import Path

import pytest
import torch
from test_measured import stored, surface, written

import torchms
from torchms.cli import main
from torchms.measured import MeasuredBRDF
from torchms.measured.fit import INCIDENCE, NAMES, fitted, samples
from torchms.measured.least_squares import least_squares

FILES = Path(__file__).parents[3] / "shared" / "data" / "rgl"
needs_files = pytest.mark.skipif(
    not FILES.is_dir(), reason="needs the samples of rgl.epfl.ch/materials in ../shared/data/rgl"
)


def vector(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def test_errors_are_the_spread(generator):
    """An exponential in noise, fitted eighty times: mean, errors and covariance."""
    t, truth = torch.linspace(0, 1, 100, dtype=torch.float64), vector(0.7, 2.0, 0.1)

    def model(p: torch.Tensor) -> torch.Tensor:
        return p[0] * torch.exp(-p[1] * t) + p[2]

    fits = []
    for _ in range(80):
        y = model(truth) + 0.01 * torch.randn(100, generator=generator, dtype=torch.float64)
        fits.append(
            least_squares(lambda p, y=y: model(p) - y, vector(0.2, 0.5, 0.5), vector(0, 0, 0), vector(1, 10, 1))
        )
    values, errors = torch.stack([f.values for f in fits]), torch.stack([f.errors for f in fits])
    torch.testing.assert_close(values.mean(0), truth, rtol=0, atol=float(errors.max()) * 5 / math.sqrt(80))
    torch.testing.assert_close(values.std(0), errors.mean(0), rtol=0.35, atol=0)
    torch.testing.assert_close(
        torch.cov(values.T), torch.stack([f.covariance for f in fits]).mean(0), rtol=0.8, atol=1e-7
    )
    assert max(f.steps for f in fits) < 30


def test_bounds_hold_and_are_told():
    """A parameter that would leave its range stays at the end of it, without an error; the others are best for that."""
    t = torch.linspace(0, 1, 50, dtype=torch.float64)
    fit = least_squares(lambda p: p[0] + p[1] * t - 2 - 3 * t, vector(0.0, 0.0), vector(-1, -9), vector(1, 9))
    assert float(fit.values[0]) == 1 and bool(fit.errors[0].isnan()) and bool(fit.errors[1] > 0)
    assert float(fit.values[1]) == pytest.approx(3 + float(t.sum() / (t * t).sum()), abs=1e-6)


def test_samples_are_where_they_say():
    at = samples()
    assert {float(a) for a in at.angle} == set(INCIDENCE)
    assert float(at.light[:, 2].min()) > math.cos(math.radians(75)) and float(at.light[:, 1].min()) > -1e-12
    torch.testing.assert_close(at.view[:, 2], at.angle.deg2rad().cos())
    half = torch.nn.functional.normalize(at.view + at.light, dim=-1)
    assert float(half[at.near][:, 2].min()) > math.cos(math.radians(40)) and bool((half[at.near][:, 2] > 0.9999).any())


class Known(torch.nn.Module):
    """A material in the place of a measurement."""

    def __init__(self, material: torchms.BSDF) -> None:
        super().__init__()
        self.material = material

    def forward(self, view: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        return self.material(view, light)


@pytest.mark.slow
@pytest.mark.parametrize("bounces", ["all", "one"])
def test_what_is_known_is_found(bounces):
    """A paint of the model itself, from other numbers."""
    truth = (0.6, 0.3, 0.1, 0.2, 0.45, 1.4)
    known = torchms.MetallicRoughness(vector(*truth[:3]), vector(0.2)[0], 0.45, ior=1.4, bounces=bounces)
    every = samples()
    some = type(every)(*(x[::6] for x in every))
    found = fitted(Known(known), bounces, diffuse="lambert", at=some)
    torch.testing.assert_close(found.values, vector(*truth), rtol=0, atol=1e-3)
    assert found.rms() < 1e-4


@needs_files
@pytest.mark.slow
@pytest.mark.parametrize(("name", "gain"), [("paper_white", 0.5), ("satin_rosaline", 0.97)])
def test_where_all_bounces_help(name, gain):
    """White paper is described four times as well; of a satin film nothing is gained."""
    brdf = MeasuredBRDF.load(FILES / f"{name}_rgb.bsdf")
    residuals = {bounces: fitted(brdf, bounces).rms() for bounces in ("all", "one")}
    ratio = residuals["all"] / residuals["one"]
    assert (ratio < gain) if gain < 0.9 else (gain < ratio < 1.03), residuals


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    """Table, numbers and picture of a small file of one's own; what will not do is refused before the work."""
    path = stored(tmp_path, written(surface()))
    out, numbers = tmp_path / "fit.png", tmp_path / "fit.json"
    arguments = ["fit-measured", path, "--out", str(out), "--json", str(numbers), "--metallic", "0"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "a test" in printed and "0.0000 held" in printed and "residual, view at 65 deg" in printed
    document = json.loads(numbers.read_text())
    assert document["fits"]["one"]["values"].keys() == set(NAMES) and document["fits"]["all"]["values"]["metallic"] == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert main(arguments) == 2 and "exists already" in capsys.readouterr().err


def test_what_is_refused(tmp_path, capsys):
    path = stored(tmp_path, written(surface()))
    for words, message in (
        (["--metallic", "2"], "--metallic must lie in [0, 1]; got 2"),
        (["--ior", "0.5"], "--ior must lie in [1, 2.5]; got 0.5"),
        (["--out", str(tmp_path / "a.jpg")], "--out must end in .png; got a.jpg"),
        (["--json", str(tmp_path / "no" / "a.json")], "does not exist"),
    ):
        assert main(["fit-measured", path, *words]) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "bad.bsdf").write_bytes(b"nothing")
    assert main(["fit-measured", str(tmp_path / "bad.bsdf")]) == 2
    assert "bad.bsdf is no tensor_file" in capsys.readouterr().err
