"""A segment of somebody's own, which draws two random numbers a leg."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import torch
from cases import ONE_OF_EACH, bsdf, direction, each
from torch import Tensor

from torchms import GGX, HeightWalk, RoughConductor, Unidirectional
from torchms.fresnel import Ideal
from torchms.maths.frame import split
from torchms.paths.height import HeightState, RandomHeight
from torchms.paths.segments import Leg
from torchms.testing import estimate, law_suite, p_value, zscore


class TwoNumbers(RandomHeight):
    """The heights of `RandomHeight`, from the sum of two numbers modulo 1: uniform only if both are, whatever the other."""

    n_uniforms = 2

    def start(self, first: Leg, monotone: bool) -> HeightState:
        return super().start(self._of_one(first), monotone)

    def extend(self, state: HeightState, leg: Leg) -> HeightState:
        return super().extend(state, self._of_one(leg))

    def _of_one(self, leg: Leg) -> Leg:
        return leg._replace(numbers=(torch.frac(sum(leg.numbers, torch.zeros_like(leg.lam))),))


class Counted(Sequence[Tensor]):
    """Random numbers that count how often each was read."""

    def __init__(self, numbers: Tensor) -> None:
        self.numbers, self.reads = numbers, Counter()

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, i: Any) -> Any:
        self.reads[i] += 1
        return self.numbers[i]


@each("material", ONE_OF_EACH)
def test_no_number_is_drawn_twice(material, generator, messages):
    """Every number of a walk is read once (type checks would read more), and there is none beyond `n_uniforms`."""
    scattering = Unidirectional(TwoNumbers(), 5)
    vertex = bsdf(material, "height-walk").vertex
    wi, wo = (split(direction(theta)[None].expand(1, 1, 3)) for theta in (0.5, 0.9))
    numbers = torch.rand(scattering.n_uniforms(vertex), 1, 1, generator=generator, dtype=torch.float64)
    for read in (
        lambda u: scattering.evaluate(vertex, wi, wo, u),
        lambda u: list(scattering.walk(vertex, wi, u)),
    ):
        u = Counted(numbers)
        read(u)
        assert set(u.reads.values()) == {1} and max(u.reads) < len(numbers)


def test_the_laws_hold_for_it():
    report = law_suite(RoughConductor(GGX(0.8), Ideal(), Unidirectional(TwoNumbers(), 6)), samples=5000)
    assert not report.failed, report


def test_it_is_the_height_walk(generator, budget):
    """The energy of each order, in expectation."""
    wi = direction(0.7)[None]
    energies = []
    for scattering in (Unidirectional(TwoNumbers(), 4), HeightWalk(4)):
        surface = RoughConductor(GGX(1.0), Ideal(), scattering).double()
        walk = surface.sample_walk(wi, surface.uniforms((1,), 40_000, generator=generator))
        order = walk.order[0, :, None] == torch.arange(1, 5)
        energies.append(estimate(walk.weight[0] * order))
    budget(p_value(zscore(*energies, rounding=1e-9)))
