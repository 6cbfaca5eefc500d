"""Segment terms against the height walk they stand for, integrated in closed form."""

import itertools
from fractions import Fraction

import pytest
import torch
from cases import SEGMENTS, TOLERANCES, each
from torch import Tensor

from torchms.paths.height import RandomHeight
from torchms.paths.segments import Invariance, Leg
from torchms.testing import estimate, exactly, p_value, zscore

RTOL, ATOL = TOLERANCES[torch.float64]
LENGTHS = range(1, 8)
EXAMPLE = (-1.7, -1.3, 0.8, -2.3, 0.8)
"""The diffuse path of docs/theory.md, section 4, for which the two-term recursion gives 0."""


def sequences(k: int, n: int, generator: torch.Generator, mirror: bool = False) -> Tensor:
    """Signed Λ of `n` paths (n, k + 1): the first down, the last up; down…down up…up if `mirror`."""
    size = 0.05 + 3 * torch.rand(n, k + 1, generator=generator, dtype=torch.float64)
    up = torch.rand(n, k + 1, generator=generator) < 0.5
    if mirror:
        up = up.sort(1).values
    up[:, 0], up[:, -1] = False, True
    return torch.where(up, size, -1 - size)


def height_walk(Lambda: tuple[float, ...]) -> float:
    """Probability that the walk of docs/theory.md, section 6, along these directions leaves exactly after the last.

    In closed form: the density of U is a sum of powers c U^s on (0, 1), here {s: c}, at every bounce: a descent maps p(U) to
    ∫_U'^1 p(U) λ U'^(λ−1) U^−λ dU, a blocked ascent to ∫_0^U' p(U) Λ U^Λ U'^(−Λ−1) dU; an escape is ∫ p(U) U^Λ dU.
    """
    first, *middle, last = (Fraction(lam) for lam in Lambda)  # exact: the sum cancels
    powers = {-first - 1: -first}
    for lam in middle:
        after: dict[Fraction, Fraction] = {}
        for s, c in powers.items():
            if lam > 0:
                after[s] = after.get(s, 0) + c * lam / (s + lam + 1)
            else:
                step = c * -lam / (s + lam + 1)
                after[-lam - 1] = after.get(-lam - 1, 0) + step
                after[s] = after.get(s, 0) - step
        powers = after
    return float(sum(c / (s + last + 1) for s, c in powers.items()))


def normalised(segment: torch.nn.Module, Lambda: Tensor) -> Tensor:
    """e_k: the segment term times |Λ| of every direction but the last."""
    return segment(Lambda) * Lambda[..., :-1].abs().prod(-1)


@each("k", LENGTHS)
def test_invariance_is_the_height_walk(k, generator):
    """For every sequence of ups and downs of up to seven bounces, to rounding."""
    Lambda = sequences(k, 100, generator)
    truth = torch.tensor([height_walk(tuple(path)) for path in Lambda.tolist()], dtype=torch.float64)
    torch.testing.assert_close(normalised(Invariance(), Lambda), truth, rtol=1e-11, atol=0)


def test_the_example_that_refutes_two_terms():
    """Truth 0.219 [docs/theory.md, section 4]; the recursion of [Cui2023] gives 0, since it never sees the middle split."""
    path = torch.tensor(EXAMPLE, dtype=torch.float64)
    assert height_walk(EXAMPLE) == pytest.approx(0.219, abs=5e-4)
    assert float(normalised(Invariance(), path)) == pytest.approx(height_walk(EXAMPLE), rel=1e-12)
    assert float(fast_invariance(path[None])) == 0


def fast_invariance(Lambda: Tensor) -> Tensor:
    """e_k by the two-term recursion of mirrors."""
    legs = [Leg(x.abs(), x >= 0) for x in Lambda.unbind(-1)]
    state = Invariance().start(legs[0], monotone=True)
    for leg in legs[1:-1]:
        state = Invariance().extend(state, leg)
    return Invariance().escape(state, legs[-1])


@each("k", LENGTHS)
def test_two_terms_are_enough_for_mirrors(k, generator):
    Lambda = sequences(k, 200, generator, mirror=True)
    torch.testing.assert_close(fast_invariance(Lambda), normalised(Invariance(), Lambda), rtol=RTOL, atol=ATOL)


@each("k", range(1, 6))
def test_random_heights_are_the_height_walk(k, generator, budget):
    """The walk that carries its height, in expectation."""
    Lambda = sequences(k, 6, generator)
    numbers = torch.rand(k, 50_000, 6, generator=generator, dtype=torch.float64)
    legs = [Leg(x.abs(), x > 0, None, (u,)) for x, u in zip(Lambda.unbind(-1)[:-1], numbers, strict=True)]
    state = RandomHeight().start(legs[0], False)
    for leg in legs[1:]:
        state = RandomHeight().extend(state, leg)
    last = Lambda[:, -1].expand(50_000, 6)
    ours = estimate(RandomHeight().escape(state, Leg(last, last > 0)))
    truth = torch.tensor([height_walk(tuple(path)) for path in Lambda.tolist()], dtype=torch.float64)
    budget(p_value(zscore(ours, exactly(truth), rounding=1e-9)))


@each("segment", SEGMENTS)
def test_one_bounce_is_G2(segment, generator):
    """S(d_0, d_1) = 1 / (1 + Λ(wi) + Λ(wo)) [Heitz2014, Eq. 99]; separable for the uncorrelated model."""
    Lambda = sequences(1, 100, generator)
    Lambda_i, Lambda_o = -1 - Lambda[:, 0], Lambda[:, 1]
    G2 = 1 / (1 + Lambda_i + Lambda_o)
    if segment == "uncorrelated":
        G2 = 1 / ((1 + Lambda_i) * (1 + Lambda_o))
    torch.testing.assert_close(SEGMENTS[segment]()(Lambda), G2, rtol=RTOL, atol=ATOL)


@each("segment", SEGMENTS)
def test_escape_and_stay_sum_to_one(segment, generator):
    """Along any directions Σ_k e_k → 1: light leaves sometime. It does so at the first chance to leave upward, too."""
    Lambda = sequences(60, 50, generator)
    shares = [normalised(SEGMENTS[segment](), Lambda[:, : k + 1]) * (Lambda[:, k] > 0) for k in range(1, 41)]
    total = torch.stack(shares).sum(0)
    assert (total <= 1 + 1e-12).all()
    assert (total > 1 - 1e-2).double().mean() > 0.9


@each("segment", SEGMENTS)
@each("k", LENGTHS)
def test_reversed_path(segment, k, generator):
    """S(d_0 … d_k) = S(−d_k … −d_0), with Λ(−d) = −1 − Λ(d), exactly where the class says that it is reciprocal."""
    model = SEGMENTS[segment]()
    Lambda = sequences(k, 200, generator)
    there, back = model(Lambda), model(-1 - Lambda.flip(-1))
    if model.is_reciprocal or k == 1:
        torch.testing.assert_close(there, back, rtol=1e-12, atol=0)
    else:
        assert ((there - back).abs() > 1e-3 * there).double().mean() > 0.9


def test_correlated_is_not_reciprocal_by_two_terms(generator):
    """[Wang2022] Eqs. 25 and 26: a middle direction that goes down there, and so up on the way back."""
    model = SEGMENTS["correlated"]()
    before, middle, after = sequences(2, 100, generator, mirror=True).unbind(-1)
    middle = torch.where(middle > 0, -1 - middle, middle)
    path = torch.stack([before, middle, after], -1)
    reversed_before, reversed_middle = -1 - before, -1 - middle  # Λ(−d_{i−1}) and Λ(−d_i) of the print
    there = 1 / (1 + reversed_before) / (1 + reversed_middle + after)
    back = reversed_middle / ((1 + after) * (1 + after + reversed_middle)) / (reversed_middle + reversed_before)
    torch.testing.assert_close(model(path), there, rtol=RTOL, atol=ATOL)
    torch.testing.assert_close(model(-1 - path.flip(-1)), back, rtol=RTOL, atol=ATOL)
    assert ((there - back).abs() > 1e-3 * there).all()


@each("segment", SEGMENTS)
def test_no_light_from_below_or_into_the_ground(segment):
    """S = 0 unless d_0 points down and d_k up."""
    size = torch.tensor([0.3, 1.2, 0.4], dtype=torch.float64)
    for ups in itertools.product([True, False], repeat=3):
        Lambda = torch.where(torch.tensor(ups), size, -1 - size)
        value = float(SEGMENTS[segment]()(Lambda))
        assert (value > 0) == (not ups[0] and ups[2])


def test_what_has_no_closed_term_says_so():
    with pytest.raises(TypeError, match="RandomHeight draws heights"):
        RandomHeight()(torch.tensor([-1.2, 0.3]))
    with pytest.raises(ValueError, match="at least d_0 and d_1"):
        Invariance()(torch.tensor([-1.2]))
