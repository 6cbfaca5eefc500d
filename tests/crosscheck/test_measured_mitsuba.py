"""Measured BRDFs against Mitsuba 3's plugin `measured`, which computes in float32."""

from importlib import import_module
from pathlib import Path

import pytest
import torch
from cases import directions
from test_bsdf_mitsuba import value

from torchms.measured import MeasuredBRDF

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

FILES = Path(__file__).parents[3] / "shared" / "data" / "rgl"
NAMES = ("paper_white_rgb", "colodur_napoli_4f_rgb", "satin_rosaline_rgb", "cc_ibiza_sunset_rgb")
TOLERANCE = 1e-5


@pytest.mark.skipif(not FILES.is_dir(), reason="needs the samples of rgl.epfl.ch/materials in ../shared/data/rgl")
@pytest.mark.parametrize("name", NAMES)
def test_values(name, generator):
    """Over the hemisphere and about the mirror direction; relative to a value or 1 % of the largest."""
    mi = import_module("mitsuba")
    mi.set_variant("scalar_rgb")
    path = FILES / f"{name}.bsdf"
    wi, anywhere = directions(100, generator, 0.02), directions(50, generator, -0.2)
    mirror = wi[50:] * torch.tensor([-1.0, -1.0, 1.0]) + 0.05 * directions(50, generator)
    wo = torch.nn.functional.normalize(torch.cat([anywhere, mirror]), dim=-1)
    wi, wo = wi.float().double(), wo.float().double()
    expected = value(mi, {"type": "measured", "filename": str(path)}, wi, wo)
    found = MeasuredBRDF.load(path).double()(wi, wo)
    error = (found - expected).abs() / (expected.abs() + 0.01 * expected.max())
    assert float(error.max()) < TOLERANCE
