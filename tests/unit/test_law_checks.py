"""The law checks themselves: they accept what is right, and they can fail."""

import math

import pytest
import torch
from cases import bsdf, direction, directions

from torchms.testing import (
    Estimate,
    chi_square,
    chi_square_p_value,
    combined,
    estimate,
    exactly,
    p_value,
    reciprocity,
    share_zscore,
    sidak,
    sphere_cells,
    white_furnace,
    zscore,
)

F64 = torch.float64


def test_estimate_is_the_mean_and_its_error(generator):
    x = torch.randn(10_000, 3, generator=generator) * 2 + 1
    mean, error, n = estimate(x)
    torch.testing.assert_close(error, torch.full((3,), 0.02, dtype=F64), rtol=0.05, atol=0)
    assert n == 10_000 and ((mean - 1).abs() < 5 * error).all()
    with pytest.raises(ValueError, match="at least 2 samples"):
        estimate(torch.zeros(1, 3))


def test_z_and_p():
    a = Estimate(torch.tensor([1.0, 1.0, 2.0], dtype=F64), torch.tensor([0.3, 0.0, 0.0], dtype=F64), 10)
    b = Estimate(torch.tensor([0.5, 1.0, 1.0], dtype=F64), torch.tensor([0.4, 0.0, 0.0], dtype=F64), 10)
    assert zscore(a, b).tolist() == pytest.approx([1.0, 0.0, math.inf])
    assert zscore(a, b, rounding=0.5).tolist() == pytest.approx([0.0, 0.0, math.inf])
    assert p_value(torch.tensor([0.0, -1.959964, math.inf])).tolist() == pytest.approx([1, 0.05, 0], abs=1e-6)


def test_rare_shares_are_compared_as_counts():
    """0 of 1e6 against 3 of 1e6 is nothing; against 30 it is; a sample without an event has no error to divide by."""
    none = Estimate(torch.zeros((), dtype=F64), torch.zeros((), dtype=F64), 10**6)
    few, many = (
        Estimate(torch.tensor(k * 1e-6, dtype=F64), torch.tensor(math.sqrt(k) * 1e-6, dtype=F64), 10**6)
        for k in (3, 30)
    )
    assert abs(share_zscore(none, none)) == 0
    assert abs(share_zscore(none, few)) < 2.5
    assert share_zscore(none, many) < -5
    half = exactly(torch.tensor(0.5))
    frequent = Estimate(torch.tensor(0.51, dtype=F64), torch.tensor(0.001, dtype=F64), 10**4)
    assert float(share_zscore(frequent, Estimate(half.mean, half.stderr, 10**9))) == pytest.approx(10)


def test_one_budget():
    """n tests at the Šidák level all pass with probability 1 − level; the combined p of one is its own."""
    assert (1 - sidak(0.01, 50)) ** 50 == pytest.approx(0.99)
    assert combined([0.3]) == pytest.approx(0.3)
    assert combined([0.3, 0.01]) == pytest.approx(1 - 0.99**2)
    assert combined([1e-20] * 3) == pytest.approx(3e-20)
    assert combined([0.5, math.nan]) == 0
    with pytest.raises(ValueError, match="at least one"):
        combined([])


def test_chi_square_of_counts(generator, budget):
    """Right counts pass; a cell too full, or one that should be empty, does not; rare cells are pooled."""
    expected = torch.tensor([1000.0, 500.0, 3.0, 2.0, 1.0])
    assert chi_square_p_value(expected, expected) == pytest.approx(1)
    assert chi_square_p_value(torch.tensor([1000, 500, 0, 0, 6]), expected) > 0.9
    assert chi_square_p_value(torch.tensor([1200, 300, 3, 2, 1]), expected) < 1e-9
    assert chi_square_p_value(torch.tensor([10, 1]), torch.tensor([11, 0])) == 0
    draws = torch.randint(0, 20, (200, 1000), generator=generator)
    p = [chi_square_p_value(torch.bincount(d, minlength=20), torch.full((20,), 50.0)) for d in draws]
    assert 0.4 < sum(p) / 200 < 0.6
    budget(p)


def test_chi_square_of_directions(generator, budget):
    """Uniform directions are uniform; they are not cosine-distributed, and half a density is none."""
    w = directions(20_000, generator)
    budget([chi_square(w, lambda x: torch.full((len(x),), 0.25 / math.pi), (8, 8))])
    up = directions(20_000, generator, 0.0)
    assert chi_square(up, lambda x: x[:, 2].clamp_min(0) / math.pi, (8, 8)) < 1e-12
    with pytest.raises(ValueError, match="must integrate to 1"):
        chi_square(w, lambda x: torch.full((len(x),), 0.125 / math.pi), (8, 8))


def test_quadrature_finds_peaks_and_edges():
    """A constant, a jump at the horizon, a Gaussian a hundredth of a radian wide; cells add up to the whole."""
    assert float(sphere_cells(lambda w: torch.ones(len(w)), (4, 8), 1e-6).sum()) == pytest.approx(4 * math.pi, rel=1e-9)
    up = sphere_cells(lambda w: (w[:, 2] > 0.1).double(), (4, 8), 1e-4)
    assert float(up.sum()) == pytest.approx(2 * math.pi * 0.9, abs=1e-3)
    assert up.shape == (4, 8) and (up[:2] == 0).all()
    centre = direction(0.9)
    peak = sphere_cells(lambda w: torch.exp((w @ centre - 1) / 1e-4), (16, 32), 1e-9)
    assert float(peak.sum()) == pytest.approx(2 * math.pi * 1e-4, rel=1e-5)


def test_a_dark_surface_fails_the_furnace(generator):
    surface = bsdf("conductor[conductor]", "invariance", max_order=20)
    energy = white_furnace(surface, direction(0.5)[None], surface.uniforms((1,), 500, generator=generator))
    assert energy.mean.shape == (1, 3) and (energy.mean < 0.99).all()


def test_reciprocity_wants_numbers_where_values_are_estimates():
    with pytest.raises(ValueError, match=r"u_back=.*needed"):
        reciprocity(bsdf("diffuse", "single"), direction(0.5), direction(0.6))
