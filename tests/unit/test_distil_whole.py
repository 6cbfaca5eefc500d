"""Steps that look at all rows: slope and matrix are those of their objective, and they go down and on where they were."""

from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from torchms.approximations.distil import glass_rows, whole
from torchms.approximations.distil.glass_fit import Fit, balanced
from torchms.approximations.distil.rows import OUTGOING
from torchms.approximations.distil.weights import sizes_of
from torchms.approximations.distilled import packaged
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.glass_lobes import Side


def fit_of(
    generator: torch.Generator, units: Sequence[Sequence[int]] = ((5, 4), (3,)), begin: Distillate | None = None
) -> Fit:
    """What a few surfaces reflect: some smooth lobe, and energies to be kept."""
    where = glass_rows.drawn((0.2, 1.0), 40, generator)
    lobes = glass_rows.lobes("GGX", where, True, OUTGOING, generator)
    wo = lobes.wo.reshape(-1, 3)
    f = torch.stack([0.05 * wo[:, 2], (0.02 + 0.01 * wo[:, 0]) * wo[:, 2]], 1)
    fit = Fit("GGX", where, wo, lobes.weights.reshape(-1), f, (units[0], units[1]), 1, begin)
    balanced([fit], "GGX", glass_rows.drawn((0.2, 1.0), 8, generator), 2)
    return fit


def test_slope_and_matrix_are_those_of_the_objective(generator):
    """Along a random direction; the matrix of many drawn rows and of all points against that of every row, as derivatives."""
    fit = fit_of(generator)
    held = whole.slope(fit.level, fit.vector, fit.data, fit.cells)
    assert held.value == pytest.approx(whole.value(fit.level, fit.vector, fit.data, fit.cells, held), rel=1e-5)
    along = torch.randn(len(fit.vector), generator=generator)
    step = 1e-2 / float(along.norm())
    there, back = (whole.value(fit.level, fit.vector + s * step * along, fit.data, fit.cells, held) for s in (1, -1))
    expected = 2 * float(held.slope @ along[fit.level.places].double())
    assert (there - back) / (2 * step) == pytest.approx(expected, rel=2e-2)
    g, columns = fit.level.derivatives(fit.vector, fit.data.inputs)
    columns = columns * (g * held.rows.sqrt())[:, None]
    assert fit.cells is not None
    some = fit.cells.part(0, 0)
    found = whole.matrix(fit.level, fit.vector, fit.data, some, held._replace(energies=held.energies[:0]), 1 << 15, 3)
    expected = (columns.T @ columns).double()
    assert float((found - expected).norm() / expected.norm()) < 0.02


def test_steps_go_down_and_on(generator, tmp_path: Path):
    """Six at once are three and then three more, bit for bit."""
    fit, found = fit_of(generator), []
    assert fit.cells is not None
    # Light that is made up keeps no energy.
    cells = fit.cells.part(0, 0)
    for name, parts in (("at once", (6,)), ("in parts", (3, 6))):
        path = tmp_path / f"{name}.npz"
        vectors = [
            whole.refined(fit.weights, fit.vector, fit.data, cells, steps, 4, path, lambda count: None, 2048)
            for steps in parts
        ]
        found.append(vectors[-1])
    assert torch.equal(*found)
    before, after = (whole.slope(fit.level, v, fit.data, cells).value for v in (fit.vector, found[0]))
    assert after < 0.8 * before


@pytest.mark.parametrize("more", [0, 3])
def test_a_file_to_begin_with(generator, more):
    """Networks of as many units, or of more, begin as the file's, and all units can learn; fewer are refused."""
    begin = packaged("GGX", "reflected")
    units = [[n + more for n in numbers] for numbers in sizes_of(begin)]
    fit = fit_of(generator, units, begin)
    found = fit.distillate("reflected", begin.alpha)
    assert sizes_of(found) == tuple(units)
    pairs, of_both = torch.randn(21, 64, generator=generator), torch.randn(12, 2, 64, generator=generator)
    mine, its = (Side(each)(tuple(pairs), tuple(of_both)) for each in (found, begin))
    torch.testing.assert_close(mine, its, rtol=1e-4, atol=1e-3)
    held = whole.slope(fit.level, fit.vector, fit.data, fit.cells)
    (layers, _), (of_one, _) = fit.weights.split(
        torch.zeros_like(fit.vector).index_put((fit.level.places,), held.slope.float())
    )
    assert layers[-1][0].all() and of_one[-1][0].all()
    with pytest.raises(ValueError, match="--packaged"):
        fit_of(generator, [[5, 4], units[1]], begin)
