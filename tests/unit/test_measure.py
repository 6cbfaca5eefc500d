"""Energies and lobes of a BSDF by its own walk."""

import json

import pytest
import torch
from cases import bsdf, direction, each, models

from torchms import GGX, RoughConductor
from torchms.fresnel import Ideal
from torchms.lobes import measure
from torchms.testing import Estimate, estimate, p_value, zscore

WI = direction(0.8)


@models()
def test_measure_is_the_albedo(material, scattering, generator, budget):
    """The same energies as `albedo`, and standard errors that are those of its paths."""
    surface = bsdf(material, scattering, max_order=3)
    tally = measure(surface, WI, n_paths=20_000, seed=3, progress=False)
    u = surface.uniforms((20_000,), 1, generator=generator)
    p = []
    for mean, error, paths in (
        (tally.reflected, tally.reflected_stderr, surface.albedo(WI, u).reflected),
        (tally.transmitted, tally.transmitted_stderr, surface.albedo(WI, u).transmitted),
    ):
        theirs = estimate(paths)
        p.append(p_value(zscore(Estimate(mean, error, tally.n), theirs)))
        frequent = theirs.mean > 0.01
        torch.testing.assert_close(error[frequent], theirs.stderr[frequent], rtol=0.1, atol=0)
    budget(torch.stack(p))


@models()
def test_the_parts_make_the_whole(material, scattering):
    """total is the sum of the orders, and with rest (where no facet absorbs) it is one; lobes sum to the energies.

    The planes are as many for a model of fewer orders: light that bounces more often is not there.
    """
    surface = bsdf(material, scattering, max_order=3)
    tally = measure(surface, WI, n_paths=5000, bins=(8, 4), progress=False)
    both = tally.reflected + tally.transmitted
    torch.testing.assert_close(both.sum(0), tally.total)
    if material == "dielectric":
        torch.testing.assert_close(tally.total + tally.remaining, torch.ones(1, dtype=torch.float64))
    assert tally.lobes is not None
    energies = tally.lobes.mean.sum((1, 2)) * tally.lobes.bin_sr
    orders = min(3, surface.max_order)
    torch.testing.assert_close(energies[:orders], both[:orders])
    assert (energies[orders:3] == 0).all()
    torch.testing.assert_close(energies[-1], tally.total)
    assert tally.lobes.mean.shape == tally.lobes.stderr.shape == (4, 8, 4, surface.n_channels)
    up = tally.lobes.mean[:, 4:].sum((1, 2)) * tally.lobes.bin_sr
    torch.testing.assert_close(up[-1], tally.reflected.sum(0))


@each("threads", [1, 2, 5])
def test_threads_do_not_change_a_result(threads):
    """A result depends on seed and n_paths only."""
    surface = bsdf("dielectric", "height-walk", max_order=2)
    once = measure(surface, WI, n_paths=40_000, seed=1, progress=False, threads=threads)
    again = measure(surface, WI, n_paths=40_000, seed=1, progress=False, threads=1)
    other = measure(surface, WI, n_paths=40_000, seed=2, progress=False, threads=threads)
    assert torch.equal(once.reflected, again.reflected) and not torch.equal(once.reflected, other.reflected)


def test_a_table_goes_to_json():
    tally = measure(bsdf("diffuse", "invariance"), WI, n_paths=100, progress=False)
    table = json.loads(json.dumps(tally.to_dict()))
    assert table["n"] == 100 and torch.tensor(table["reflected"]).shape == (4, 3)


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize(
    "wi,n_paths,alpha,message",
    [
        (WI[None], 100, 0.5, r"wi=\.\.\.\) must be one direction \(3,\); got shape \(1, 3\)"),
        (-WI, 100, 0.5, r"wi=\.\.\.\) must lie above the horizon"),
        (WI, 1, 0.5, r"n_paths=\.\.\.\) must be at least 2; got 1"),
        (WI, 100, torch.full((4,), 0.5), r"scalar parameters; got a per-pixel map"),
    ],
    ids=["a batch", "from below", "one path", "a map"],
)
def test_bad_input(wi, n_paths, alpha, message):
    with pytest.raises(ValueError, match=message):
        measure(RoughConductor(GGX(alpha), Ideal()), wi, n_paths=n_paths, progress=False)
