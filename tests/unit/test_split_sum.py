"""Tables of what rough metal returns: their columns, the files, and the line that reads them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from test_dropins import hemisphere

from torchms import GGX, HeightWalk, RoughConductor, SingleBounce, Stream
from torchms.cli import main
from torchms.dropins import split_sum
from torchms.dropins.split_sum import ALL_BOUNCES, ONE_BOUNCE, centres, one_bounce, towards
from torchms.fresnel import Schlick

F0 = np.array([1.0, 0.95, 0.8, 0.5, 0.2, 0.04, 0.0])


def read(line: str, texels: list[np.ndarray], f0: np.ndarray) -> np.ndarray:
    """E of a line of GLSL, as numpy reads it: the words of GLSL that it uses mean the same there."""
    a, b = ([SimpleNamespace(**dict(zip("xyzw", t, strict=False))) for t in texels] + [None])[:2]
    words = {"f0": f0, "a": a, "b": b, "pow": np.power, "max": np.maximum, "vec3": np.float64}
    words["mix"] = lambda x, y, way: x * (1 - way) + y * way
    assert line.startswith("vec3 E = ") and line.endswith(";")
    return eval(line.removeprefix("vec3 E = ").removesuffix(";"), words)


def test_scale_and_bias_are_the_integrals():
    """Of the values of one bounce over the hemisphere, for any F0; a table of four rows."""
    n = 4
    found = one_bounce(n)
    light, angle = hemisphere(96)
    for i, r in enumerate(centres(n).tolist()):
        if r < 0.3:
            continue
        metal = RoughConductor(GGX(r * r), Schlick([1.0, 0.3, 0.0]), SingleBounce()).double()
        energy = 2 * (metal(towards(centres(n))[:, None], light) * angle[:, None]).sum(1)
        scale, bias = found[i].unsqueeze(-1).unbind(1)
        torch.testing.assert_close(scale * torch.tensor([1.0, 0.3, 0.0]).double() + bias, energy, rtol=2e-4, atol=2e-4)


def test_the_file_is_row_after_row(tmp_path, capsys):
    """Little-endian float32; smooth surfaces reflect all of F0 = 1, and rows are roughness."""
    path = tmp_path / "bsdf_8_8.bin"
    assert main(["lut", "--out", str(path), "--size", "8"]) == 0
    table = np.fromfile(path, "<f4").reshape(8, 8, 2)
    np.testing.assert_array_equal(table, one_bounce(8).float().numpy())
    assert (table[0].sum(-1) > 0.99).all() and table[7, 7].sum() < 0.5, "a row is a roughness"
    assert table[0, 0, 1] > 0.5 > 0.01 > table[0, 7, 1], "a column is N·V: what grazes is reflected whatever F0 is"
    assert f"GLSL, of texels at vec2(NdotV, roughness): {ONE_BOUNCE}" in capsys.readouterr().out
    np.testing.assert_allclose(read(ONE_BOUNCE, [table[7, 3]], F0), F0 * table[7, 3, 0] + table[7, 3, 1])


@pytest.fixture(scope="module")
def planes(tmp_path_factory) -> np.ndarray:
    """The file of all bounces, of 16 rows, as a renderer gets it."""
    path = tmp_path_factory.mktemp("lut") / "all.bin"
    assert main(["lut", "--out", str(path), "--size", "16", "--bounces", "all"]) == 0
    return np.fromfile(path, "<f4").reshape(2, 16, 16, 4)


@pytest.mark.slow
def test_all_bounces_of_white_is_white(planes):
    """And all columns are shares; the first two are those of one bounce."""
    assert planes.min() >= 0 and planes.max() <= 1
    for i in range(16):
        for j in range(16):
            assert read(ALL_BOUNCES, [planes[0, i, j], planes[1, i, j]], F0[:1])[0] == pytest.approx(1, abs=2e-6)
    np.testing.assert_array_equal(planes[0, ..., :2], one_bounce(16).float().numpy())


PLACES = ((2, 15), (3, 0), (5, 2), (7, 8), (11, 1), (11, 15), (15, 0), (15, 4), (15, 15))
WORST = 3e-3
"""Of an energy; most of it is the law by which orders from the fourth on fall off."""


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES, ids=str)
def test_the_line_is_the_energy_of_walks(place, planes, seed):
    """[Heitz2016], for every F0, at roughnesses and angles that are no nodes of the table."""
    i, j = place
    r, cosine = (i + 0.5) / 16, (j + 0.5) / 16
    metal = RoughConductor(GGX(r * r), Schlick(torch.from_numpy(F0)), HeightWalk(24)).double()
    wi = towards(torch.full((4,), cosine, dtype=torch.float64))
    walks = metal.albedo(wi, Stream(seed % 1000 + torch.arange(4), 1 << 10, "sobol")).reflected.sum(1)
    found = read(ALL_BOUNCES, [planes[0, i, j], planes[1, i, j]], F0)
    error, noise = np.abs(found - walks.mean(0).numpy()), walks.std(0).numpy() / 2
    assert (error < WORST + 5 * noise).all(), (error, noise)
    assert noise.max() < 2e-3


@pytest.mark.slow
def test_one_bounce_alone_would_be_dark(planes):
    """What the table is for: at r = 1 it is off by more than half of the light, and all bounces are no line in F0."""
    a, b = planes[0, 15, 15], planes[1, 15, 15]
    assert read(ONE_BOUNCE, [a], F0[:1])[0] < 0.4
    E = read(ALL_BOUNCES, [a, b], np.array([0.0, 0.5, 1.0]))
    assert E[1] < 0.7 * (E[0] + E[2]) / 2


def test_smoother_than_the_walks(monkeypatch):
    """Below the least α of the walks the columns go on without a step."""
    monkeypatch.setattr(split_sum, "WALKS", 1 << 8)
    later = split_sum.Later.walked(lambda rows: None)
    least = split_sum.LEAST_ALPHA
    alpha = torch.tensor([0.98, 1.0, 1.02], dtype=torch.float64) * least
    for cosine in (0.01, 0.1, 0.9):
        at = later.at(alpha, torch.full((3,), cosine, dtype=torch.float64))
        for columns in (at.shares, at.weights):
            assert float(columns.diff(dim=-1).abs().max()) < 0.03


def test_what_is_refused(tmp_path, capsys):
    path = tmp_path / "t.bin"
    path.write_bytes(b"mine")
    assert main(["lut", "--out", str(path), "--size", "4"]) == 2
    assert "exists already" in capsys.readouterr().err and path.read_bytes() == b"mine"
    assert main(["lut", "--out", str(path), "--size", "1", "--force"]) == 2
    assert "--size must lie in [2, 4096]; got 1" in capsys.readouterr().err
    assert main(["lut", "--out", str(path), "--size", "2", "--force"]) == 0
    assert path.stat().st_size == 2 * 2 * 2 * 4 and [p.name for p in tmp_path.iterdir()] == ["t.bin"]
    assert math.isfinite(float(np.fromfile(path, "<f4").sum()))
