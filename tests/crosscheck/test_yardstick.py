"""The scalar walk that speeds are measured against computes the same thing: it shares no code with the library."""

import sys
from pathlib import Path

import pytest
import torch
from torch import Tensor

from torchms import GGX, Beckmann, Bidirectional, Invariance, RoughConductor, Stream
from torchms.fresnel import Ideal
from torchms.testing import estimate, p_value, zscore

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
yardstick = pytest.importorskip("yardstick", reason="the yardstick needs numba")

K, PAIRS, WALKS = 5, 6, 40_000
CASES = [
    ("ggx", GGX, 0.5),
    pytest.param("ggx", GGX, 1.0, marks=pytest.mark.slow),
    pytest.param("beckmann", Beckmann, 0.5, marks=pytest.mark.slow),
    ("beckmann", Beckmann, 1.0),
]


def directions(generator: torch.Generator) -> Tensor:
    """Up to 70° from the normal."""
    z = 1 - 0.65 * torch.rand(PAIRS, generator=generator)
    phi = 6.28 * torch.rand(PAIRS, generator=generator)
    r = (1 - z * z).sqrt()
    return torch.stack([r * phi.cos(), r * phi.sin(), z], -1)


@pytest.mark.parametrize(("name", "distribution", "alpha"), CASES)
def test_values(name, distribution, alpha, generator, seed, budget) -> None:
    """Its mean over many walks against the bidirectional estimator."""
    wi, wo = directions(generator), directions(generator)
    kind = {"ggx": yardstick.GGX, "beckmann": yardstick.BECKMANN}[name]
    many = [w.repeat_interleave(WALKS, 0).numpy() for w in (wi, wo)]
    theirs = estimate(torch.from_numpy(yardstick.evaluate(*many, alpha, kind, K, seed)).reshape(PAIRS, WALKS), 1)
    surface = RoughConductor(distribution(alpha), Ideal(), Bidirectional(Invariance(), K))
    batches = torch.stack([surface(wi, wo, Stream(i, 64))[:, 0] for i in range(40)])
    budget(p_value(zscore(theirs, estimate(batches), 1e-5 * theirs.mean)))


@pytest.mark.parametrize(("name", "distribution", "alpha"), CASES)
def test_walks(name, distribution, alpha, generator, seed, budget) -> None:
    """Where its walks leave: first and second moments of the directions against `sample_walk`."""
    wi = directions(generator)
    kind = {"ggx": yardstick.GGX, "beckmann": yardstick.BECKMANN}[name]
    walks = torch.from_numpy(yardstick.walk(wi.repeat_interleave(WALKS, 0).numpy(), alpha, kind, K, seed))
    theirs = walks.reshape(PAIRS, WALKS, 3)
    surface = RoughConductor(distribution(alpha), Ideal(), Bidirectional(Invariance(), K))
    ours = surface.sample_walk(wi, Stream(3, WALKS))
    directions_out = ours.wo * ours.weight
    p = []
    for moment in (lambda w: w, lambda w: w * w):
        a, b = moment(theirs), moment(directions_out)
        p.append(p_value(zscore(estimate(a, 1), estimate(b, 1), 1e-6)))
    budget(torch.cat(p))
