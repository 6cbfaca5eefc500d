"""Energies, order by order, against the independent height walks of the reference table."""

import json

import pytest
import torch
from cases import ELLIPTIC, LOSSLESS, serves
from reference import BIASED, ENERGY, ROWS, SHARED, checksum, counted, incident, model, oracles

from torchms.lobes import measure
from torchms.testing import Estimate, p_value, share_zscore

ROUNDING = 0.5e-8
"""Half of the last digit that the table holds."""

SIDES = ("R", "T")


def test_the_copy_is_the_original():
    original = SHARED / "heitz_energy.json"
    if not original.exists():
        pytest.skip(f"{original} is not at hand; the committed copy is used")
    assert checksum(original) == ENERGY["provenance"]["sha256"]
    assert {**json.loads(original.read_text()), "provenance": ENERGY["provenance"]} == ENERGY


@oracles(100_000, 1_000_000)
def test_every_order_agrees(name, scattering, n_paths, seed, budget):
    """HeightWalk and Invariance are the Smith model: E_r,k, E_t,k and what is left beyond K = 10."""
    row = ROWS[name]
    tally = measure(model(row, scattering), incident(row), n_paths=n_paths, seed=seed, progress=False)
    means = torch.cat([tally.reflected, tally.transmitted, tally.remaining[None]])[:, 0]
    errors = torch.cat([tally.reflected_stderr, tally.transmitted_stderr, tally.remaining_stderr[None]])[:, 0]
    theirs = torch.tensor([*row["R"], *row["T"], row["R_rest"] + row["T_rest"]], dtype=torch.float64)
    z = share_zscore(Estimate(means, errors, n_paths), counted(theirs, row["n"]), ROUNDING)
    budget(
        p_value(z),
        lambda i: f"{(*SIDES, 'remaining')[i // 10]}[{i % 10}] = {means[i]:.3g} ± {errors[i]:.2g}, {theirs[i]:.3g}",
    )


@pytest.mark.parametrize("distribution", ELLIPTIC)
@pytest.mark.parametrize("scattering", ["single", "height-walk", "invariance"])
def test_the_first_order_is_the_quadrature(scattering, distribution, seed, budget):
    """E_r,1 of the conductor, known to many digits."""
    keys = [key for key in ENERGY["e1_quadrature"] if key.startswith(distribution)]
    p = []
    for key in keys:
        _, ax, ay, theta = key.split("|")
        row = {
            "material": "conductor",
            "distribution": distribution,
            "alpha": [float(ax), float(ay)],
            "theta_i": float(theta),
        }
        tally = measure(model(row, scattering, 1), incident(row), n_paths=100_000, seed=seed, progress=False)
        ours = Estimate(tally.reflected, tally.reflected_stderr, tally.n)
        # The table's own error is 4e-4 at most where its caption says so of the walks; quadrature is taken as exact.
        truth = counted(torch.full((1, 1), ENERGY["e1_quadrature"][key], dtype=torch.float64), 10**12)
        p.append(p_value(share_zscore(ours, truth, 1e-6)))
    budget(torch.stack(p), lambda i: keys[i])


@pytest.mark.parametrize("material", LOSSLESS)
@pytest.mark.parametrize("distribution", ELLIPTIC)
def test_biased_models_conserve_energy(material, distribution, seed):
    """Uncorrelated and Correlated lose nothing; how far each order is from the height walk is printed (pytest -rP)."""
    for name, row in ROWS.items():
        if (row["material"], row["distribution"]) != (material, distribution):
            continue
        for scattering in BIASED:
            assert serves(LOSSLESS[material], scattering)
            tally = measure(model(row, scattering), incident(row), n_paths=5000, seed=seed, progress=False)
            assert float(tally.total + tally.remaining) == pytest.approx(1, abs=1e-5)
            assert float(tally.remaining) < 0.02
            for side, ours in zip(SIDES, (tally.reflected, tally.transmitted), strict=True):
                bias = ours[:4, 0] - torch.tensor(row[side][:4], dtype=torch.float64)
                if side == "R" or material == "dielectric":
                    print(f"{name:32} {scattering:12} {side}  " + " ".join(f"{b:+.4f}" for b in bias.tolist()))
