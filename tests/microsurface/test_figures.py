"""The figures: files, numbers beside them, and that the plane of incidence is where it should be."""

import json
import math
from pathlib import Path

import pytest
import torch

from torchms.cli.figures import run_figures
from torchms.cli.options import FiguresOptions
from torchms.microsurface import GridTracer
from torchms.microsurface.simulation.comparison import SIMULATION, Case, plane_of_incidence


@pytest.mark.parametrize("material", ["conductor", "dielectric"])
def test_figure_has_its_numbers_beside_it(tmp_path: Path, material: str) -> None:
    options = FiguresOptions(
        material=material,
        alpha=0.6,
        alpha_y=0.3,
        theta=(0.0, 1.0),
        rays=4000.0,
        walks=2000.0,
        surfaces=2,
        size=128,
        max_order=5,
        out=tmp_path / "figures",
    )
    paths = run_figures(options)
    assert [p.name for p in paths] == [f"{material}_a0.6_0.3.{s}" for s in ("png", "svg", "json")]
    assert paths[0].read_bytes().startswith(b"\x89PNG") and b"<svg" in paths[1].read_bytes()
    content = json.loads(paths[2].read_text())
    names = {SIMULATION, "height walk", "uncorrelated", "correlated"}
    # Invariance knows one side of the surface only.
    names |= {"invariance"} if material == "conductor" else set()
    for panel in content["panels"]:
        assert set(panel["models"]) == names
        for model in panel["models"].values():
            assert len(model["reflected"]) == 5 and model["total"] + model["remaining"] == pytest.approx(1, abs=1e-5)
            assert len(model["value"]["k ≥ 4"]) == len(panel["angle"]) == 128
    with pytest.raises(FileExistsError):
        run_figures(options)


def test_mirror_side_is_positive() -> None:
    case = Case("conductor", (0.1, 0.1), 0.9, phi=2.2)
    tally = case.simulated(2, 256, 20_000, 1, GridTracer())
    angle, value, error = plane_of_incidence(tally, case.phi)
    assert (angle.diff() > 0).all() and angle.abs().max() < math.pi
    peak = angle[value[0].argmax()].item()
    assert peak == pytest.approx(0.9, abs=0.1)
    assert torch.isfinite(error).all() and (value >= 0).all()
    # The four planes are the parts of the fifth.
    assert torch.allclose(value[:4].sum(0), value[4], atol=1e-12)


@pytest.mark.usefixtures("plain_messages")
def test_unknown_material_is_named() -> None:
    with pytest.raises(ValueError, match=r"material=.*'wood'"):
        Case("wood", (0.5, 0.5), 0.0)
