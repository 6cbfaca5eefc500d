"""Distillations of explicit surfaces: single paths against the tally, the likelihood, a small scan from heights to a file."""

from pathlib import Path

import numpy as np
import pytest
import torch

from torchms import Beckmann, Distilled, RoughConductor, RoughDiffuse
from torchms.approximations import distilled_file as files
from torchms.approximations.distil import adam_state
from torchms.approximations.distil.rows import Rows, surfaces
from torchms.approximations.distil.training import inputs_of
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.surface_correction import ORDERS
from torchms.approximations.surface_lobes import SurfaceLobes, of_smith
from torchms.cli import main
from torchms.fresnel import Ideal
from torchms.maths.frame import split
from torchms.microsurface import GridTracer, Heightfield, MirrorFacets, simulate
from torchms.microsurface.distil import fit, held_out, light, likelihood, scan
from torchms.microsurface.distil.kinds import KINDS
from torchms.microsurface.distil.networks import Correction
from torchms.microsurface.distil.smith import beckmann, smith_diffuse, smith_orders
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster
from torchms.microsurface.simulation.exits import exits, stretched

KEY = np.array([3, 4], dtype=np.uint32)
pytestmark = pytest.mark.filterwarnings("ignore:Heightfield.from_heights")


def caster(surface: Heightfield) -> GridCaster:
    return GridTracer().bind(Grid.of(surface))


def incident(theta: float, n: int) -> np.ndarray:
    return np.broadcast_to([np.sin(theta), 0.0, np.cos(theta)], (n, 3))


def test_paths_are_those_of_the_tally():
    """Energies of the orders agree within four standard errors, and every path has left in some direction, upward."""
    surface, n = Heightfield.gaussian(0.8, size=256, seed=1), 40_000
    found = exits(caster(surface), MirrorFacets(), incident(0.9, n), KEY, 20)
    tally = simulate(surface, MirrorFacets(), incident(0.9, 1)[0], n_rays=n, tracer=GridTracer(), lobes=False)
    share = np.bincount(found.order, minlength=5)[1:5] / n
    expected = tally.reflected[:4, 0].numpy()
    assert (np.abs(share - expected) < 4 * np.sqrt(2 * expected * (1 - expected) / n) + 1e-4).all()
    left = found.order > 0
    assert left.mean() > 0.9999 and (found.wo[left, 2] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(found.wo[left], axis=1), 1, atol=1e-6)
    # One bounce: the cosine is that between wi and the half vector.
    once = found.order == 1
    half = found.wo[once] + incident(0.9, int(once.sum()))
    cosine = (half / np.linalg.norm(half, axis=1, keepdims=True) * incident(0.9, 1)).sum(1)
    np.testing.assert_allclose(found.steep[once], (1 - cosine) ** 5, atol=1e-5)


def test_a_stretched_tile_is_the_surface_of_that_roughness():
    """Slopes times 0.5 and 0.25 are lengths times 2 and 4: the same paths, but for a few that graze an edge."""
    surface = Heightfield.gaussian(1.0, size=256, seed=2)
    dx, dy = surface.spacing
    longer = Heightfield(surface.heights, (2 * dx, 4 * dy))
    one, other = (
        exits(c, MirrorFacets(), incident(0.7, 5000), KEY, 20)
        for c in (stretched(caster(surface), 0.5, 0.25), caster(longer))
    )
    same = (one.order == other.order) & (np.abs(one.wo - other.wo).max(1) < 1e-3)
    assert same.mean() > 0.99


def correction(generator: torch.Generator, n: int = 200) -> tuple[Correction, Rows, torch.Tensor]:
    rows = surfaces((0.1, 1.0), n, generator)
    rows = rows._replace(wo=rows.wi.flip(0))
    model = Correction((6, 5), (4,), inputs_of("Beckmann", rows))
    vector = model.initial(generator)
    return model, rows, vector + 0.2 * torch.randn(len(vector), generator=generator)


def test_the_likelihood_is_highest_at_the_lobe(generator):
    """Light drawn from corrected lobes: the loss is least at that correction, and its gradient there is noise.

    Paths weigh what they would be drawn with, at the points of the integral: only rounding is left.
    """
    model, rows, vector = correction(generator, 64)
    where = Rows(*(x.repeat_interleave(8, 0) for x in rows))
    inputs = model.standardised(inputs_of("Beckmann", where))
    smith = torch.rand(len(where.ax), ORDERS, generator=generator)
    light_there = smith * torch.exp(model.outputs(vector, inputs))
    white = light_there.reshape(64, -1).sum(1).repeat_interleave(8)[:, None]
    smith, light_there = smith / white, light_there / white
    points = likelihood.Points(inputs, smith, 8)
    many, order = (
        type(inputs)(*(x.repeat_interleave(ORDERS, 0) for x in inputs)),
        torch.arange(ORDERS).repeat(len(where.ax)),
    )
    paths = likelihood.Paths(many, order, light_there.flatten(), torch.arange(65) * 8 * ORDERS)

    there = vector.clone().requires_grad_(True)
    likelihood.loss(model, there, paths, points).backward()
    assert there.grad is not None and float(there.grad.abs().max()) < 1e-5
    for _ in range(5):
        step = 0.1 * torch.randn(len(vector), generator=generator)
        said = [float(likelihood.loss(model, v, paths, points)) for v in (vector + step, vector)]
        assert said[0] > said[1]


def folded(model: Correction, vector: torch.Tensor, outputs: int) -> tuple[list, torch.Tensor, tuple]:
    """Layers, linear part and network of each direction, with `outputs` more that are 0."""
    pair, each = model.folded(vector)
    zeros = torch.zeros(outputs, pair[0][-1][0].shape[1]), torch.zeros(outputs), torch.zeros(outputs, len(model.mean))
    return *fit.joined(pair, model, zeros), each


def test_what_was_learned_is_what_runs(generator):
    """The networks of a file are the corrections of the vector that they were folded from, exchanged directions too."""
    model, rows, vector = correction(generator)
    layers, skip, each = folded(model, vector, 4)
    lobes = SurfaceLobes(
        files.Distillate("gaussian", "Beckmann", (0.1, 1.0), layers, skip, {}, each, of_smith(beckmann()))
    )
    c = model.outputs(vector, model.standardised(inputs_of("Beckmann", rows)))
    found = lobes.rest(Beckmann(rows.ax, rows.ay), split(rows.wi), split(rows.wo))
    back = lobes.rest(Beckmann(rows.ax, rows.ay), split(rows.wo), split(rows.wi))
    torch.testing.assert_close(found.first, torch.exp(c[:, 0]), rtol=1e-3, atol=0)
    torch.testing.assert_close(found.first, back.first, rtol=1e-4, atol=0)
    smith = smith_orders(rows)[:, 1:] / rows.wo[:, 2:]
    for k, lobe in enumerate(found.lobes):
        torch.testing.assert_close(lobe, smith[:, k] * torch.exp(c[:, k + 1]), rtol=2e-3, atol=1e-9)


def test_what_was_learned_of_diffuse_facets_is_what_runs(generator, tmp_path: Path):
    """The same, written and read; with an albedo, orders are its powers, but for the last, which ends in a series."""
    model, rows, vector = correction(generator)
    layers, skip, each = folded(model, vector, 1)
    base = KINDS["diffuse"].base()
    files.write(
        tmp_path / "a.npz",
        files.Distillate("gaussian_diffuse", "Beckmann", (0.09, 1.1), layers, skip, {}, each, base),
    )
    lobes = Distilled(tmp_path / "a.npz")
    c = model.outputs(vector, model.standardised(inputs_of("Beckmann", rows)))
    ax, ay = (x.clamp(0.1, 1.0) for x in (rows.ax, rows.ay))
    rows = rows._replace(ax=ax, ay=ay)
    c = model.outputs(vector, model.standardised(inputs_of("Beckmann", rows)))
    white, gray = (RoughDiffuse(Beckmann(ax, ay), rho, lobes).orders(rows.wi, rows.wo)[..., 0] for rho in (1.0, 0.5))
    torch.testing.assert_close(white, smith_diffuse(rows) * torch.exp(c), rtol=2e-3, atol=1e-9)
    torch.testing.assert_close(gray[:, :3], white[:, :3] * torch.tensor([0.5, 0.25, 0.125]))
    last = gray[:, 3] / white[:, 3]
    assert ((last > 0) & (last < 0.0625 + 1e-6)).all()


def test_integrals_are_those_of_smiths_walks(generator):
    """What the points say leaves after one, two and three bounces is what walks carry, to four standard errors."""
    n = 4000
    rows = surfaces((0.3, 0.9), n, generator)
    model = RoughConductor(Beckmann(rows.ax, rows.ay), Ideal(), Distilled())
    walk = model.sample_walk(rows.wi, model.uniforms((n,), generator=generator))
    where, inverse = fit.answers(rows, KINDS["conductor"].proposal, 5)
    smith = (smith_orders(where) * inverse[:, None]).reshape(n, fit.POINTS, ORDERS).mean(1)
    for k in range(3):
        gap = torch.where(walk.order[:, 0] == k + 1, walk.weight[:, 0, 0], 0.0) - smith[:, k]
        assert abs(float(gap.mean())) < 4 * float(gap.std()) / n**0.5 + 1e-3


def test_errors_have_no_noise_in_them():
    """Light drawn from a lobe is as far from that lobe as nothing, and from another as that one is."""
    torch.manual_seed(0)
    lobe = torch.rand(1, held_out.ORDERS, held_out.ROWS, held_out.COLUMNS, dtype=torch.float64)
    lobe /= lobe.sum()
    n = 400_000
    counts = [torch.bincount(torch.multinomial(lobe.flatten(), n, True), minlength=lobe.numel()) / n for _ in range(2)]
    drawn = torch.stack([c.reshape(lobe.shape) for c in counts])
    assert float(held_out.errors(drawn, lobe).lobe[0]) < 0.02 < float(held_out.errors(drawn, lobe).noise[0])
    assert float(held_out.errors(drawn, 1.1 * lobe).lobe[0]) == pytest.approx(0.1, abs=0.01)


def rough(tmp_path: Path) -> Path:
    """A height map that is not its own mirror image: its slopes lean to one side."""
    h = Heightfield.gaussian(0.6, size=256, seed=7).heights
    path = tmp_path / "scan.npy"
    np.save(path, h + 0.3 * np.abs(h))
    return path


@pytest.mark.slow
def test_a_scan_becomes_lobes(tmp_path: Path, capsys):
    """From heights to a file: nearer to the light than Smith's theory, for its own slopes, the same bits after a stop."""
    path = rough(tmp_path)
    words = ["distil", "--surface", str(path), "--spacing", "0.0625", "--height-scale", "1", "--periodic"]
    words += ["--paths", "5e5", "--steps", "200", "--held-out", "1e5", "--work", str(tmp_path / "work")]
    assert main([*words, "--out", str(tmp_path / "scan.npz"), "--json", str(tmp_path / "scan.json")]) == 0
    assert "distilled" in capsys.readouterr().out
    model = Distilled(tmp_path / "scan.npz")
    metal = RoughConductor(model.slopes, Ideal(), model).double()
    wi, wo = torch.nn.functional.normalize(torch.randn(2, 50, 3, dtype=torch.float64), dim=-1).abs()
    there, back = metal(wi, wo)[:, 0] / wo[:, 2], metal(wo, wi)[:, 0] / wi[:, 2]
    torch.testing.assert_close(there, back, rtol=1e-6, atol=1e-9)
    assert (there > 0).all()
    found = files.read(tmp_path / "scan.npz", NETWORKS)
    errors = found.certificate["largest lobe error"]
    assert errors["distilled"] < errors["Smith"]
    assert main([*words, "--out", str(tmp_path / "again.npz")]) == 0
    again = files.read(tmp_path / "again.npz", NETWORKS)
    assert all(torch.equal(a[0], b[0]) for a, b in zip(found.layers, again.layers, strict=True))
    with pytest.raises(ValueError, match="must lie in"):
        RoughConductor(Heightfield.gaussian(0.2, size=256, seed=1).distribution(), Ideal(), model)


def test_hostile_scans(tmp_path: Path, capsys):
    """Units that are not given, holes, slopes that are not resolved or of which nothing is known: one line says what to do."""
    path = rough(tmp_path)
    out = ["--out", str(tmp_path / "x.npz")]

    def refused(*words: str) -> str:
        assert main(["distil", "--surface", str(path), *out, *words]) == 2
        return capsys.readouterr().err

    assert "give --spacing and --height-scale" in refused()
    assert "give --height-scale" in refused("--spacing", "1")
    units = ("--spacing", "0.0625", "--height-scale", "1", "--periodic")
    assert "--steps" in refused(*units, "--steps", "0")
    assert "one or two numbers" in refused("--spacing", "1", "1", "1", "--height-scale", "1")
    assert "alpha along y is 0.0" in refused("--spacing", "0.0625", "6.25", "--height-scale", "1", "--periodic")
    assert "no lobes are known" in refused("--spacing", "1", "--height-scale", "0.001", "--periodic")
    assert "low-pass the heights" in refused("--spacing", "0.002", "--height-scale", "1", "--periodic")
    np.save(path, np.where(np.arange(64 * 64).reshape(64, 64) == 70, np.nan, 0.1))
    assert "nan at index" in refused(*units)
    assert not (tmp_path / "x.npz").exists()


def test_a_rough_scan_may_be_taken_as_it_is():
    """`coarse` lets a scan through whose facets do not resolve its slopes."""
    h = np.random.default_rng(1).normal(size=(64, 64)) * 0.2
    surface = Heightfield(h, (1.0, 1.0))
    with pytest.raises(ValueError, match="a spacing of"):
        scan.check(surface, False)
    scan.check(surface, True)


def test_a_block_is_whole_or_not_there(tmp_path: Path):
    """Blocks that are there are not made again; what is kept of one bounce stands for all of it, in every direction."""
    calls = []

    def block(number: int) -> dict[str, np.ndarray]:
        calls.append(number)
        one = np.ones(light.PATHS, np.float32)
        up = np.tile(np.float32([0, 0, 1]), (light.PATHS, 1))
        order = (1 + (np.arange(light.PATHS) % 4 == 0)).astype(np.uint8)
        return {"ax": one, "ay": one, "wi": up, "wo": up, "order": order, "steep": 0 * one}

    light.made(tmp_path, [0, 1], block, 2, lambda n: None)
    light.made(tmp_path, [0, 1], block, 2, lambda n: None)
    assert sorted(calls) == [0, 1]
    found = light.loaded(tmp_path, 2, 3)
    directions = 2 * light.BATCHES * light.DIRECTIONS
    assert len(found.where.ax) == directions and found.first[-1] == len(found.order) == len(found.rows.wi)
    for begin, end in zip(found.first[:-1], found.first[1:], strict=True):
        order, weight = found.order[begin:end], found.weight[begin:end]
        assert float(weight[order == 1].sum()) == pytest.approx(0.75 * light.RAYS)
        assert float(weight[order == 2].sum()) == 0.25 * light.RAYS
    assert len(found.order) < 0.5 * 2 * light.PATHS
    assert torch.equal(found.order, light.loaded(tmp_path, 2, 3).order)


def test_a_stopped_fit_goes_on(tmp_path: Path, generator, monkeypatch):
    """The same bits after a stop, and likelier lobes than Smith's."""
    monkeypatch.setattr(adam_state, "SAVED", 4)
    model, rows, _ = correction(generator, 32)
    where = Rows(*(x.repeat_interleave(4, 0) for x in rows))
    inputs = model.standardised(inputs_of("Beckmann", where))
    paths = likelihood.Paths(inputs, torch.arange(128) % ORDERS, torch.full((128,), 0.25), torch.arange(33) * 4)
    points = likelihood.Points(inputs, torch.rand(128, ORDERS, generator=generator) / 8, 4)
    start = model.initial(generator)

    def fitted(steps: int, name: str, stop: int = 99) -> torch.Tensor:
        left = iter(range(stop))
        return likelihood.fitted(
            model, start, paths, points, steps, tmp_path / name, lambda n: n and next(left) and None
        )

    whole = fitted(8, "a.npz")
    with pytest.raises(StopIteration):
        fitted(8, "b.npz", 5)
    assert torch.equal(fitted(8, "b.npz"), whole)
    assert float(likelihood.loss(model, whole, paths, points)) < float(likelihood.loss(model, start, paths, points))
