"""What one facet does, against what is known in closed form on a flat surface; and the random numbers it uses."""

import math

import numpy as np
import pytest
import torch

from torchms.maths.frame import direction
from torchms.microsurface import DielectricFacets, DiffuseFacets, GridTracer, Heightfield, MirrorFacets, simulate
from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.simulation.launch import launch
from torchms.microsurface.simulation.philox import philox_words

FLAT = Heightfield.from_heights(np.zeros((16, 16)), 1.0, periodic=True)


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_philox_known_answers(counter: list[int], key: list[int], words: list[int]) -> None:
    # Known-answer vectors of Random123 [Salmon2011].
    out = philox_words(np.array(counter, dtype=np.uint32), np.array(key, dtype=np.uint32))
    assert out.tolist() == words


def test_rays_start_uniformly_and_in_the_order_of_the_curve() -> None:
    n = 65536
    p = Paths.empty(n, 1, False)
    place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
    launch(0, n, np.array([5, 6], dtype=np.uint32), np.array([0.6, 0.0, 0.8]), 100, 60, 3.5, *place, n)
    assert (p.z == 3.5).all() and (p.d == [-0.6, 0.0, -0.8]).all()
    # One ray in each of the n stretches, which are squares of a 256 × 256 grid for n = 2^16.
    cells = np.histogram2d(p.x, p.y, bins=256, range=((0, 100), (0, 60)))[0]
    # (Starts are rounded to float32, which moves one or the other over an edge.)
    assert (cells != 1).sum() <= 6
    # Inside its square a ray is anywhere alike, and squares do not know of each other.
    u, v = (p.x / 100 * 256) % 1, (p.y / 60 * 256) % 1
    for w in (u, v):
        assert abs(w.mean() - 0.5) < 5 / math.sqrt(12 * n) and abs(w.var() - 1 / 12) < 5e-3
    assert abs(np.corrcoef(u, v)[0, 1]) < 5 / math.sqrt(n)
    step = np.hypot(np.diff(p.x), np.diff(p.y))
    assert np.median(step) < 100 / 256 * 2


@pytest.mark.parametrize("eta", [1.5, 1 / 1.5, 2.4])
@pytest.mark.parametrize("theta", [0.0, 0.5, 1.0, 1.5])
def test_flat_glass_is_fresnel_and_snell(eta: float, theta: float) -> None:
    n = 200_000
    tally = simulate(
        FLAT, DielectricFacets(eta), direction(theta, 0.4), n_rays=n, max_order=3, seed=8, tracer=GridTracer()
    )
    ci, sin_t = math.cos(theta), math.sin(theta) / eta
    ct = math.sqrt(max(1 - sin_t**2, 0.0))
    F = 1.0
    if sin_t < 1:
        F = 0.5 * (((ci - eta * ct) / (ci + eta * ct)) ** 2 + ((eta * ci - ct) / (eta * ci + ct)) ** 2)
    reflected, transmitted = tally.reflected[0, 0].item(), tally.transmitted[0, 0].item()
    assert reflected + transmitted == pytest.approx(1, abs=1e-9)
    assert reflected == pytest.approx(F, abs=5 * math.sqrt(F * (1 - F) / n) + 1e-9)
    assert tally.lobes is not None
    mean = tally.lobes.mean[3, :, :, 0]
    # All reflected light in the bin of the mirror direction, all refracted light in that of Snell's.
    azimuth = int(((0.4 + math.pi) % (2 * math.pi)) / (2 * math.pi) * 64)
    ways = [(ci, reflected)] + ([(-ct, transmitted)] if sin_t < 1 else [])
    for cosine, energy in ways:
        row = mean[min(int((cosine + 1) * 32), 63)]
        in_bin = row.sum() if theta == 0 else row[azimuth]
        assert in_bin.item() * tally.lobes.bin_sr == pytest.approx(energy, abs=1e-9)


def test_flat_mirror_reflects_with_the_fresnel_term() -> None:
    def schlick(c: torch.Tensor) -> torch.Tensor:
        f0 = torch.tensor([0.9, 0.5, 0.1], dtype=c.dtype)
        return f0 + (1 - f0) * (1 - c[..., None]) ** 5

    tally = simulate(FLAT, MirrorFacets(schlick), direction(1.1, 0.4), n_rays=1000, max_order=2, tracer=GridTracer())
    expected = schlick(torch.tensor(math.cos(1.1), dtype=torch.float64))
    assert tally.reflected[0].tolist() == pytest.approx(expected.tolist(), abs=1e-8)
    assert tally.info["absorbed"] == pytest.approx((1 - expected).tolist(), abs=1e-8)
    assert tally.info["lost"] == [0.0, 0.0, 0.0]


def test_flat_diffuse_is_lamberts_law() -> None:
    n = 400_000
    tally = simulate(FLAT, DiffuseFacets((0.5, 1.0)), direction(0.8, 0.4), n_rays=n, max_order=2, tracer=GridTracer())
    assert tally.reflected[0].tolist() == pytest.approx([0.5, 1.0])
    assert tally.lobes is not None
    energy = tally.lobes.mean[3, :, :, 1] * tally.lobes.bin_sr
    assert energy[:32].sum() == 0
    edges = torch.linspace(0, 1, 33, dtype=torch.float64)
    expected = edges[1:] ** 2 - edges[:-1] ** 2
    z = (energy[32:].sum(1) - expected) / torch.sqrt(expected * (1 - expected) / n)
    assert z.abs().max() < 5
    z = (energy.sum(0) - 1 / 64) / math.sqrt(1 / 64 / n)
    assert z.abs().max() < 5


@pytest.mark.parametrize(
    "material", [MirrorFacets(), DielectricFacets(1.5), DiffuseFacets()], ids=["mirror", "glass", "diffuse"]
)
def test_directions_stay_unit_and_leave_the_facet(material) -> None:
    grid = Grid.of(Heightfield.gaussian(1.0, 0.3, size=128, seed=2))
    caster, n = GridTracer().bind(grid), 20_000
    slopes = np.stack([np.roll(grid.heights, -1, a) - grid.heights for a in (0, 1)], -1).astype(np.float64)
    for interpolate in (False, True):
        p = Paths.empty(n, 1, False)
        p.n, key = n, np.array([1, 2], dtype=np.uint32)
        place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
        launch(0, n, key, direction(1.3, 0.4).numpy(), 128, 128, grid.launch_height, *place, n)
        caster.cast(p)
        coming = p.d.copy()
        material.scatter(p, grid, 1, key, interpolate)
        assert np.abs((p.d**2).sum(1) - 1).max() < 1e-12
        i, j, upper = (p.tri >> 1) // 128, (p.tri >> 1) % 128, p.tri & 1
        sx = slopes[i, (j + upper) % 128, 0] * grid.kx
        sy = slopes[(i + upper) % 128, j, 1] * grid.ky
        m = np.stack([-sx, -sy, np.ones(n)], -1)
        assert ((coming * m).sum(1) < 0).all()
        assert ((p.d * m).sum(1) * p.side > -1e-12).all()


@pytest.mark.usefixtures("plain_messages")
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DielectricFacets(1.0), r"eta=.*1.0"),
        (lambda: DielectricFacets(-2.0), r"eta=.*\[0.1, 10\].*-2.0"),
        (lambda: DiffuseFacets(1.5), r"albedo=.*\[0, 1\]; got 1.5"),
        (lambda: MirrorFacets(lambda c: c), r"fresnel=.*\(\.\.\., C\)"),
        (lambda: MirrorFacets(lambda c: 2 + c[..., None]), "fresnel="),
    ],
)
def test_bad_materials(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
