"""Lobes, order by order and cell by cell, against the independent height walks of the reference table."""

from reference import ROWS, incident, lobe_counts, model, oracles

from torchms.lobes import measure
from torchms.testing import Estimate, p_value, share_zscore


@oracles(50_000, 200_000)
def test_every_cell_agrees(name, scattering, n_paths, seed, budget):
    """The energy that leaves into each of 16 × 8 cells after one, two, three and all bounces."""
    row = ROWS[name]
    theirs = lobe_counts(row)
    tally = measure(
        model(row, scattering),
        incident(row),
        n_paths=n_paths,
        seed=seed,
        bins=tuple(theirs.mean.shape[1:]),
        progress=False,
    )
    lobes = tally.lobes
    assert lobes is not None
    ours = Estimate(lobes.mean[..., 0] * lobes.bin_sr, lobes.stderr[..., 0] * lobes.bin_sr, n_paths)
    budget(p_value(share_zscore(ours, theirs)), lambda i: f"plane and cell {divmod(i, 128)}")
