"""Distillations: derivatives, and a small one from its seed to a file that `Distilled` takes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchms import GGX, Distilled, RoughConductor
from torchms.approximations import distilled_file as files
from torchms.approximations.distil.__main__ import Options, main
from torchms.approximations.distil.level import Level
from torchms.approximations.distil.rows import OUTGOING, drawn
from torchms.approximations.distil.training import inputs_of
from torchms.approximations.distil.weights import Weights, sizes_of
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.metal_features import FEATURES
from torchms.approximations.metal_lobes import FACETS, MetalLobes
from torchms.fresnel import Ideal
from torchms.maths.frame import split


def weights_and_rows(generator: torch.Generator):
    rows, _ = drawn("GGX", (0.1, 1.0), 2 * OUTGOING, generator)
    inputs = inputs_of("GGX", rows)
    return Weights((6, 5), (4,), inputs), rows, inputs


def test_derivatives_of_the_level(generator):
    """Those that are written out are autograd's, and belong to the numbers whose places they name."""
    weights, _, inputs = weights_and_rows(generator)
    vector = weights.initial(generator)
    vector = vector + 0.3 * torch.randn(len(vector), generator=generator)
    given, level = weights.standardised(inputs), Level(weights)
    vector, given = vector.double(), type(given)(*(x.double() for x in given))
    g, derivatives = level.derivatives(vector, given)
    torch.testing.assert_close(g, level.value(vector, given))
    whole = torch.autograd.functional.jacobian(lambda v: weights.outputs(v, given)[:, 0], vector)
    assert isinstance(whole, torch.Tensor)
    others = torch.ones(len(vector), dtype=torch.bool)
    others[level.places] = False
    torch.testing.assert_close(derivatives, whole[:, level.places], rtol=1e-9, atol=1e-12)
    assert not whole[:, others].any()


def test_what_was_trained_is_what_runs(generator):
    """The networks of a file give the level of the vector that they were folded from."""
    weights, rows, inputs = weights_and_rows(generator)
    vector = weights.initial(generator)
    pair, each = weights.folded(vector)
    facets = [(torch.zeros(1, FEATURES), torch.zeros(1)), (torch.zeros(FACETS, 1), torch.zeros(FACETS))]
    lobes = MetalLobes(
        files.Distillate("metal", "GGX", (0.1, 1.0), *pair, {}, each, facets=(facets, torch.zeros(FACETS, FEATURES)))
    )
    found = lobes.rest(GGX(rows.ax, rows.ay), split(rows.wi), split(rows.wo))
    expected = Level(weights).value(vector, weights.standardised(inputs))
    torch.testing.assert_close(sum(found.lobes), expected, rtol=2e-4, atol=0)


def test_a_file_to_begin_with(generator):
    """What is unfolded from a file gives the same level: a training goes on from there."""
    weights, _, inputs = weights_and_rows(generator)
    vector = weights.initial(generator)
    vector = vector + 0.1 * torch.randn(len(vector), generator=generator)
    pair, each = weights.folded(vector)
    found = weights.unfolded(files.Distillate("metal", "GGX", (0.1, 1.0), *pair, {}, each))
    assert sizes_of(files.Distillate("metal", "GGX", (0.1, 1.0), *pair, {}, each)) == ([6, 5], [4])
    given, level = weights.standardised(inputs), Level(weights)
    torch.testing.assert_close(level.value(found, given), level.value(vector, given), rtol=2e-4, atol=0)


@pytest.mark.slow
def test_a_small_distillation(tmp_path: Path):
    """From a seed to a file; one that is stopped and asked for more goes on where it was, to the same bits."""
    options = Options(
        alpha=(0.3, 0.8),
        out=tmp_path / "one.npz",
        work=tmp_path / "one",
        blocks=1,
        paths=(2, 4),
        steps=8,
        refinements=8,
        cells=16,
        widths=(4,),
        each=(3,),
        facets=3,
        facet_steps=4,
        held_out_points=4,
        held_out_paths=(2, 4),
    )
    main(options)
    found = files.read(options.out, NETWORKS)
    assert found.alpha == (0.3, 0.8) and "--widths 4" in found.certificate["command"]
    model = RoughConductor(GGX(0.5), Ideal(), Distilled(options.out))
    wi = torch.tensor([0.6, 0.0, 0.8])
    assert float(model(wi, wi)) > 0
    stopped = replace(options, out=tmp_path / "two.npz", work=tmp_path / "two", refinements=4)
    main(stopped)
    main(replace(stopped, refinements=8, force=True))
    again = files.read(stopped.out, NETWORKS)
    assert all(torch.equal(a[0], b[0]) for a, b in zip(found.layers, again.layers, strict=True))
    with pytest.raises(ValueError, match=r"other options.*Name another folder"):
        main(replace(stopped, widths=(5,), force=True))
    with pytest.raises(FileExistsError):
        main(options)
