"""Surfaces: exact slopes, an honest report, meshes and files there and back, and clear words for bad input."""

import math

import numpy as np
import pytest
from PIL import Image

from torchms.microsurface import GaussianSurfaces, Heightfield

pytestmark = pytest.mark.usefixtures("plain_messages")


def wavy(nx: int = 48, ny: int = 32) -> np.ndarray:
    """A smooth periodic surface that is not symmetric in x and y."""
    x, y = np.arange(nx)[:, None] / nx, np.arange(ny)[None, :] / ny
    return 1.5 * np.sin(2 * math.pi * x) + 0.5 * np.cos(2 * math.pi * (x + 2 * y))


@pytest.mark.parametrize("alpha", [(0.25, 0.25), (1.0, 1.0), (1.0, 0.1), (0.3, 0.8)])
def test_slope_rms_is_exact_on_both_axes(alpha: tuple[float, float]) -> None:
    surface = Heightfield.gaussian(*alpha, size=256, seed=5)
    mesh = surface.mesh
    # By trimesh's own normals and areas, not by our differences.
    n = mesh.face_normals
    slopes = -n[:, :2] / n[:, 2:]
    assert np.sqrt(2 * (slopes**2).mean(0)) == pytest.approx(alpha, rel=1e-6)
    assert surface.alpha == pytest.approx(alpha, rel=1e-12)
    assert len(mesh.faces) == surface.n_triangles == 2 * 256**2
    assert np.prod(surface.extent) == pytest.approx((mesh.area_faces * n[:, 2]).sum(), rel=1e-9)
    assert np.ptp(mesh.vertices, axis=0)[:2] == pytest.approx(surface.extent)


def test_slopes_are_beckmann_and_the_report_says_when_they_are_not() -> None:
    report = Heightfield.gaussian(0.7, size=1024, seed=1).report()
    assert max(report["slope_distance"]) < 0.03
    assert abs(report["heights"]["skewness"]) < 0.2 and abs(report["heights"]["excess_kurtosis"]) < 0.3
    assert sum(report["heights"]["share"]) == pytest.approx(1)
    with pytest.warns(UserWarning, match="from texel to texel"):
        saw = Heightfield.from_heights(np.tile([0.0, 1.0, 2.0, 1.0], (16, 4)), 1.0, periodic=True)
    assert min(saw.report()["slope_distance"]) > 0.5


def test_seeds_are_independent_and_repeatable() -> None:
    a, b, c = (Heightfield.gaussian(0.5, size=128, seed=s).heights for s in (1, 1, 2))
    assert (a == b).all()
    # 64 correlation areas in a tile: |correlation| is about 1/8.
    assert abs(np.corrcoef(a.ravel(), c.ravel())[0, 1]) < 0.5


def test_tile_is_periodic_and_correlated_as_asked() -> None:
    h = Heightfield.gaussian(0.5, size=1024, texels_per_correlation=16, seed=3).heights
    for axis in (0, 1):
        correlation = (h * np.roll(h, 16, axis)).mean() / (h * h).mean()
        assert correlation == pytest.approx(math.exp(-1), abs=0.06)
        seam = np.abs(np.take(h, -1, axis) - np.take(h, 0, axis)).max()
        assert seam <= 1.5 * np.abs(np.diff(h, axis=axis)).max()


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".npy"])
def test_export_and_back(tmp_path, suffix: str) -> None:
    surface = Heightfield.from_heights(wavy(), (0.5, 0.25), periodic=True)
    path = tmp_path / f"surface{suffix}"
    surface.export(path)
    back = Heightfield.from_file(path, (0.5, 0.25), periodic=True)
    assert back.heights == pytest.approx(surface.heights, abs=1e-5)
    assert back.spacing == pytest.approx(surface.spacing, rel=1e-5)
    assert back.alpha == pytest.approx(surface.alpha, rel=1e-4)
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        surface.export(path)
    surface.export(path, force=True)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_16_bit_image_columns_run_along_x(tmp_path) -> None:
    h = wavy()
    steps = np.round((h - h.min()) / np.ptp(h) * 65535).astype(np.uint16)
    for suffix in (".png", ".tif"):
        path = tmp_path / f"map{suffix}"
        Image.fromarray(steps.T).save(path)
        read = Heightfield.from_file(path, (0.5, 0.25), height_scale=np.ptp(h) / 65535, periodic=True)
        truth = Heightfield.from_heights(h, (0.5, 0.25), periodic=True)
        assert read.alpha == pytest.approx(truth.alpha, rel=1e-3)
        assert read.heights == pytest.approx(truth.heights, abs=1e-4)
    Image.fromarray((steps >> 8).astype(np.uint8)).save(tmp_path / "eight.png")
    with pytest.raises(ValueError, match="16-bit"):
        Heightfield.from_file(tmp_path / "eight.png")


def test_measured_surface_is_levelled_and_mirrored() -> None:
    h = Heightfield.gaussian(0.4, size=256, seed=2).heights
    tilt = 0.3 * np.arange(200)[:, None] - 0.1 * np.arange(220)[None, :]
    surface = Heightfield.from_heights(16 * h[:200, :220] + tilt, 1.0)
    assert surface.shape == (400, 440)
    # A part of the tile, so its slope rms is that of the whole up to sampling (about 12 × 14 correlation lengths).
    assert surface.alpha == pytest.approx((0.4, 0.4), rel=0.1)
    assert (surface.heights == surface.heights[::-1]).all() and (surface.heights == surface.heights[:, ::-1]).all()


def hole() -> "object":
    mesh = Heightfield.from_heights(wavy(), 1.0, periodic=True).mesh
    mesh.update_faces(np.arange(len(mesh.faces)) != 100)
    return mesh


def overhang() -> "object":
    mesh = Heightfield.from_heights(wavy(), 1.0, periodic=True).mesh
    mesh.vertices[500, 0] += 3.5
    return mesh


def sphere() -> "object":
    import trimesh

    return trimesh.creation.icosphere(subdivisions=2)


def with_nan(value: float) -> np.ndarray:
    h = wavy()
    h[3, 17] = value
    return h


BAD = {
    "nan": (lambda: Heightfield.from_heights(with_nan(math.nan), 1.0), r"nan at index \(3, 17\)"),
    "infinite": (lambda: Heightfield.from_heights(with_nan(math.inf), 1.0), r"inf at index \(3, 17\)"),
    "colour": (lambda: Heightfield.from_heights(np.zeros((8, 8, 3)), 1.0), "2-D"),
    "spacing": (lambda: Heightfield.from_heights(wavy(), -1.0), r"spacing=.*above 0"),
    "hole": (lambda: Heightfield.from_mesh(hole()), "without holes"),
    "overhang": (lambda: Heightfield.from_mesh(overhang()), "overhang|unevenly"),
    "solid": (lambda: Heightfield.from_mesh(sphere()), "heightfield"),
    "alpha": (lambda: Heightfield.gaussian(0.0, seed=1), r"alpha=.*\[1e-3, 2\]; got 0.0"),
    "alpha_y": (lambda: GaussianSurfaces(0.5, 3.0), r"alpha_y=.*got 3.0"),
    "coarse": (
        lambda: Heightfield.gaussian(2.0, size=512, texels_per_correlation=8, seed=1),
        "texels_per_correlation=14 with size=112",
    ),
    "small": (lambda: Heightfield.gaussian(0.5, size=64, seed=1), "size=128"),
    "count": (lambda: GaussianSurfaces(0.5, count=0), "count"),
    "missing file": (lambda: Heightfield.from_file("nowhere.png"), "no file nowhere.png"),
    "suffix": (lambda: Heightfield.from_heights(wavy(), 1.0).export("a.xyz"), r"\.npy, \.ply"),
    "folder": (lambda: Heightfield.from_heights(wavy(), 1.0).export("no/such/folder/a.ply"), "folder"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_named(case: str) -> None:
    make, message = BAD[case]
    with pytest.raises((ValueError, OSError), match=message):
        make()
