"""What a part says of itself, and what is concluded from it."""

from torchms import (
    GGX,
    Bidirectional,
    Correlated,
    HeightWalk,
    Invariance,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Uncorrelated,
    Unidirectional,
)
from torchms.fresnel import Conductor, Dielectric, Ideal, Schlick
from torchms.paths.height import RandomHeight


def test_an_estimator_is_unbiased_where_its_segment_is_exact():
    """One bounce of separable heights is not that of the Smith model; one of correlated heights is [Heitz2014, Eq. 99]."""
    for estimator in (Unidirectional, Bidirectional):
        exact = {s: [estimator(s(), k).is_unbiased for k in (1, 3)] for s in (Invariance, Correlated, Uncorrelated)}
        assert exact == {Invariance: [True, True], Correlated: [True, False], Uncorrelated: [False, False]}
    assert Unidirectional(RandomHeight(), 3).is_unbiased and HeightWalk(3).is_unbiased and SingleBounce().is_unbiased


def test_a_surface_knows_whether_its_facets_absorb():
    facets = GGX(0.5)
    assert RoughConductor(facets, Ideal()).is_lossless
    assert RoughDielectric(facets, Dielectric(1.5)).is_lossless
    assert RoughDiffuse(facets, [1.0, 1.0]).is_lossless
    assert not RoughDiffuse(facets, [1.0, 0.9]).is_lossless
    for fresnel in (Conductor.metal("Cu"), Schlick(0.5), Dielectric(1.5)):
        assert not RoughConductor(facets, fresnel).is_lossless


def test_an_outside_segment_is_exact_only_if_it_says_so():
    class Mine(RandomHeight):
        is_exact = False

    assert not Unidirectional(Mine(), 3).is_unbiased
