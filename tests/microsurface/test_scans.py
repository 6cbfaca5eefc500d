"""Scans of real surfaces: what is read, in which unit, and what is refused before anything large is made."""

import hashlib
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from torchms.microsurface import Heightfield, filled
from torchms.microsurface.surfaces import scans

pytest.importorskip("SurfaceTopography", reason="the extra `scans` is not installed")

DX, DY = 2e-6, 3e-6

MAIN = """<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><Revision>ISO5436 - 2000</Revision>
<FeatureType>SUR</FeatureType><Axes>
<CX><AxisType>I</AxisType><DataType>D</DataType><Increment>{dx}</Increment><Offset>0</Offset></CX>
<CY><AxisType>I</AxisType><DataType>D</DataType><Increment>{dy}</Increment><Offset>0</Offset></CY>
<CZ><AxisType>A</AxisType><DataType>D</DataType></CZ></Axes></Record1>
<Record3><MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink>
<PointDataLink>bindata/data.bin</PointDataLink><MD5ChecksumPointData>{md5}</MD5ChecksumPointData></DataLink></Record3>
<Record4><ChecksumFile>md5checksum.hex</ChecksumFile></Record4></p:ISO5436_2>"""


def x3p(path: Path, heights: np.ndarray, points: tuple[int, int] | None = None) -> None:
    """A file as ISO 25178-72 describes it, in metres."""
    data = np.ascontiguousarray(heights.T).astype("<f8").tobytes()
    nx, ny = points or heights.shape
    main = MAIN.format(dx=DX, dy=DY, nx=nx, ny=ny, md5=hashlib.md5(data).hexdigest().upper())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("main.xml", main)
        archive.writestr("bindata/data.bin", data)
        archive.writestr("md5checksum.hex", hashlib.md5(main.encode()).hexdigest() + " *main.xml")


@pytest.fixture
def heights() -> np.ndarray:
    """(24, 20), in metres."""
    x, y = np.arange(24)[:, None] * 0.4, np.arange(20)[None, :] * 0.5
    return 1e-6 * (np.sin(x) + np.cos(y + 0.5 * x))


def same(surface: Heightfield, heights: np.ndarray, spacing: tuple[float, float], unit: float = 1.0) -> None:
    truth = Heightfield.from_heights(heights, spacing)
    assert surface.spacing == pytest.approx([unit * s for s in spacing], rel=1e-6)
    np.testing.assert_allclose(surface.heights, unit * truth.heights, rtol=1e-5, atol=unit * 1e-5 * np.ptp(heights))
    assert surface.alpha == pytest.approx(truth.alpha, rel=1e-4)


def test_x3p_says_its_units(tmp_path, heights):
    x3p(tmp_path / "a.x3p", heights)
    same(Heightfield.from_file(tmp_path / "a.x3p"), heights, (DX, DY))
    with pytest.raises(ValueError, match=r"spacing=\.\.\.\) must be left out: .*2e-06 x 3e-06 m apart"):
        Heightfield.from_file(tmp_path / "a.x3p", 1.0)
    steeper = Heightfield.from_file(tmp_path / "a.x3p", height_scale=2.0)
    same(steeper, 2 * heights, (DX, DY))


def test_text_of_points_says_its_spacing(tmp_path, heights):
    i, j = np.indices(heights.shape)
    np.savetxt(tmp_path / "a.xyz", np.stack([i * DX, j * DY, heights], -1).reshape(-1, 3) * 1e6)
    same(Heightfield.from_file(tmp_path / "a.xyz"), heights, (DX, DY), 1e6)


def test_text_with_a_header_converts_its_units(tmp_path, heights):
    """As Gwyddion exports it: a matrix whose rows run along y, lateral and height units of their own."""
    nx, ny = heights.shape
    head = f"# Channel: Topo\n# Width: {1e6 * nx * DX:g} µm\n# Height: {1e6 * ny * DY:g} µm\n# Value units: m\n"
    body = "\n".join("\t".join(f"{v:.9g}" for v in row) for row in heights.T)
    (tmp_path / "a.txt").write_text(head + body + "\n", encoding="utf-8")
    read = Heightfield.from_file(tmp_path / "a.txt")
    assert read.alpha == pytest.approx(Heightfield.from_heights(heights, (DX, DY)).alpha, rel=1e-4)


@pytest.mark.parametrize("suffix", [".txt", ".asc", ".npy", ".tif"])
def test_what_says_no_units_is_asked_for_them(tmp_path, heights, suffix):
    path = tmp_path / f"a{suffix}"
    h = heights * 1e6
    if suffix == ".npy":
        np.save(path, h)
    elif suffix == ".tif":
        Image.fromarray(h.T.astype(np.float32)).save(path)
    else:
        np.savetxt(path, h.T)
    with pytest.raises(ValueError, match=r"spacing=\.\.\.\) must be given: .* does not say how far apart"):
        Heightfield.from_file(path)
    same(Heightfield.from_file(path, (2.0, 3.0)), heights, (DX, DY), 1e6)


def test_steps_of_a_picture_are_asked_for(tmp_path, heights):
    steps = (1e10 * (heights - heights.min())).astype(np.uint16)
    Image.fromarray(steps.T).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"height_scale=\.\.\.\) must be given: .* are steps"):
        Heightfield.from_file(tmp_path / "a.png", 2.0)
    read = Heightfield.from_file(tmp_path / "a.png", (2.0, 3.0), height_scale=1e6 / 1e10)
    assert read.alpha == pytest.approx(Heightfield.from_heights(heights, (DX, DY)).alpha, rel=1e-2)


def test_holes_are_named_and_can_be_filled(tmp_path, heights):
    whole = heights.copy()
    heights[5:7, 8:11] = np.nan
    heights[0, 3] = np.nan
    x3p(tmp_path / "a.x3p", heights)
    with pytest.raises(ValueError, match=r"nan at index \(0, 3\) \(7 of 480 texels, all in \[0:7, 3:11\]\).*filled"):
        Heightfield.from_file(tmp_path / "a.x3p")
    closed = filled(heights)
    assert np.array_equal(closed[np.isfinite(heights)], heights[np.isfinite(heights)])
    assert np.abs(closed - whole).max() < 0.3 * np.ptp(whole)
    same(Heightfield.from_file(tmp_path / "a.x3p", fill=True), closed, (DX, DY))
    with pytest.raises(ValueError, match="some finite heights"):
        filled(np.full((5, 5), np.nan))


def test_a_scan_too_coarse_for_its_slopes_is_refused(tmp_path, generator):
    fine = Heightfield.gaussian(0.5, size=256, texels_per_correlation=8, seed=4)
    np.save(tmp_path / "fine.npy", fine.heights)
    np.save(tmp_path / "coarse.npy", fine.heights[::12, ::12])
    Heightfield.from_file(tmp_path / "fine.npy", fine.spacing)
    with pytest.raises(
        ValueError, match=r"coarse\.npy: along x .* too coarse.* spacing of 0\.\d+ or less instead of 1\.5"
    ):
        Heightfield.from_file(tmp_path / "coarse.npy", tuple(12 * s for s in fine.spacing))


HOSTILE: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "huge": ("a.x3p", lambda p: x3p(p, np.zeros((8, 8)), (200_000, 200_000)), "200000 x 200000 texels; at most"),
    "negative": ("a.x3p", lambda p: x3p(p, np.zeros((8, 8)), (-8, -8)), "cannot be read|at most"),
    "less data than it says": ("a.x3p", lambda p: x3p(p, np.zeros((8, 8)), (9, 9)), "cannot be read"),
    "no archive": ("a.x3p", lambda p: p.write_bytes(b"PK\x03\x04" + bytes(200)), "cannot be read"),
    "empty": ("a.x3p", lambda p: p.write_bytes(b""), "0 x 0 texels|cannot be read"),
    "prose": ("a.txt", lambda p: p.write_text("It was measured on a Friday."), "no known format of heights"),
    "a line": ("a.xyz", lambda p: np.savetxt(p, np.random.default_rng(0).random((9, 2)).cumsum(0)), "is a line of 9"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_are_refused(tmp_path, case):
    name, write, told = HOSTILE[case]
    write(tmp_path / name)
    with pytest.raises(ValueError, match=told) as caught:
        Heightfield.from_file(tmp_path / name)
    assert name in str(caught.value)


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(scans, "MOST_BYTES", 1 << 20)
    x3p(tmp_path / "a.x3p", np.zeros((512, 512)))
    assert (tmp_path / "a.x3p").stat().st_size < 1 << 14
    with pytest.raises(ValueError, match=r"is of \d{7} bytes; at most 1048576"):
        Heightfield.from_file(tmp_path / "a.x3p")


@pytest.mark.slow
def test_the_page_runs(tmp_path, monkeypatch):
    """docs/scans.md, its code one block after the other."""
    pytest.importorskip("matplotlib", reason="has the ground's heights")
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "scans.md").read_text()
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "docs/scans.md", "exec"), names)
    assert names["tally"].n == 20_000 and names["steeper"].alphas[0] == pytest.approx(1, abs=0.1)
