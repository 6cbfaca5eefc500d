"""The distillation of glass: what is trained is what runs, its directions are counted right, and a small one as a whole."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchms import GGX, Distilled, RoughDielectric
from torchms.approximations import distilled_file as files
from torchms.approximations.distil import glass, glass_held_out, glass_rows
from torchms.approximations.distil.glass_fit import Fit, inputs_of
from torchms.approximations.distil.rows import OUTGOING
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.glass_lobes import GlassLobes
from torchms.fresnel import Dielectric
from torchms.maths.frame import split
from torchms.paths.refractive import Refractive


def test_what_was_trained_is_what_runs(generator):
    """Both files give the values of the vectors that they were folded from, on either side and for either index."""
    fits, wos, expected = [], [], []
    where = glass_rows.drawn((0.1, 1.0), 6, generator)
    many = where.repeated(OUTGOING)
    for up in (True, False):
        lobes = glass_rows.lobes("GGX", where, up, OUTGOING, generator)
        wo, f = lobes.wo.reshape(-1, 3), torch.full((len(many.ax), 2), 0.1)
        fit = Fit("GGX", where, wo, lobes.weights.reshape(-1), f, ((5, 4), (3,)), 1)
        fit.vector = fit.vector + 0.1 * torch.randn(len(fit.vector), generator=generator)
        expected.append(fit.level.value(fit.vector, fit.data.inputs) * inputs_of("GGX", many, wo, up)[1])
        fits.append(fit)
        wos.append(wo)
    found = GlassLobes(*(fit.distillate(name, (0.1, 1.0)) for fit, name in zip(fits, glass.FACETS, strict=True)))
    vertex = Refractive(GGX(many.ax, many.ay), Dielectric(many.eta))
    for wo, values, up in zip(wos, expected, (True, False), strict=True):
        torch.testing.assert_close(found.rest(vertex, split(many.wi), split(wo)), values, rtol=5e-4, atol=1e-9)
        torch.testing.assert_close(glass_held_out.rest(found, "GGX", many, wo, up), values, rtol=5e-4, atol=1e-9)


@pytest.mark.parametrize("up", [True, False])
def test_outgoing_directions_cover_the_hemisphere(up, generator):
    """Their weights integrate |cos θ| over it: π."""
    where = glass_rows.drawn((0.3, 1.0), 32, generator)
    lobes = glass_rows.lobes("GGX", where, up, 4096, generator)
    assert bool(((lobes.wo[..., 2] > 0) == up).all())
    projected = (lobes.weights * lobes.wo[..., 2].abs()).sum(1)
    torch.testing.assert_close(projected.mean(), torch.tensor(torch.pi), rtol=5e-3, atol=0)


@pytest.mark.slow
def test_a_small_distillation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """From a seed to two files that `Distilled` takes; one that is stopped goes on to the same bits."""
    monkeypatch.setattr(glass, "ROWS", 2048)
    monkeypatch.setattr(glass_held_out, "PATHS", (1, 1))
    monkeypatch.setattr(glass_held_out, "QUADRATURE", 64)

    def options(name: str, rounds: tuple[int, ...]) -> glass.Options:
        return glass.Options(
            alpha=(0.3, 1.0),
            work=tmp_path / name,
            outs=(tmp_path / f"{name}_r.npz", tmp_path / f"{name}_t.npz"),
            blocks=1,
            paths=(1, 1),
            widths=(4,),
            each=(3,),
            rounds=rounds,
            rows=512,
            cells=8,
        )

    one, two = options("one", (4, 4)), options("two", (4,))
    glass.main(one)
    glass.main(two)
    glass.main(replace(two, rounds=(4, 4), force=True))
    for a, b in zip(one.outs, two.outs, strict=True):
        first, again = (files.read(path, NETWORKS) for path in (a, b))
        assert "--rounds 4 4" in first.certificate["command"] and first.certificate["held_out"]["noise"]["median"] > 0
        assert all(torch.equal(x[0], y[0]) for x, y in zip(first.layers, again.layers, strict=True))
    surface = RoughDielectric(GGX(0.5), Dielectric(1.5), Distilled(one.outs))
    wi = torch.tensor([0.6, 0.0, 0.8])
    assert (surface.orders(wi, torch.stack([wi, -wi]))[:, 1] > 0).all()
    with pytest.raises(ValueError, match=r"other options.*Name another folder"):
        glass.main(replace(one, paths=(2, 1), force=True))
    with pytest.raises(FileExistsError):
        glass.main(one)
