"""Limits: one order is SingleBounce, and α_y = α_x is the isotropic surface."""

import torch
from cases import (
    COMPENSATIONS,
    ELLIPTIC,
    SCATTERINGS,
    bsdf,
    directions,
    each,
    models,
    transmits,
)
from torch import Tensor

from torchms import BSDF
from torchms.paths.masking import G1_dist, G2_dist
from torchms.testing import Estimate, estimate, p_value, zscore

PAIRS = 8
PATHS = 4_000


def pairs(material: str, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """`PAIRS` directions each, off the horizon; those of glass from and to either side."""
    wi, wo = directions(PAIRS, generator, 0.2), directions(PAIRS, generator, 0.2)
    if transmits(material):
        side = torch.where(torch.rand(2, PAIRS, 1, generator=generator) < 0.5, -1.0, 1.0)
        return wi * side[0], wo * side[1]
    return wi, wo


def values(surface: BSDF, wi: Tensor, wo: Tensor, generator: torch.Generator) -> Estimate:
    """`forward` of each pair by `PATHS` paths: (pairs, C)."""
    wi, wo = (w[:, None].expand(-1, PATHS, -1) for w in (wi, wo))
    return estimate(surface(wi, wo, surface.uniforms((len(wi), PATHS), 1, generator=generator)), 1)


def separable(surface: BSDF, wi: Tensor, wo: Tensor) -> Tensor:
    """G1(wi) G1(wo) over the correlated term of one bounce, reflected or transmitted: (pairs, 1)."""
    facets = surface.distribution
    side = wi[:, 2:].sign()
    w, d = wi * side, wo * side
    through = d[:, 2] < 0
    G2 = torch.where(through, G2_dist(facets, w, d, transmitted=True), G2_dist(facets, w, d))
    return (G1_dist(facets, w) * G1_dist(facets, d * d[:, 2:].sign()) / G2)[:, None]


@models(scatterings=[name for name in SCATTERINGS if name != "single"])
def test_one_order_is_a_single_bounce(material, scattering, generator, budget):
    """K = 1, to rounding where both are closed forms, else in expectation; Uncorrelated has G1 G1 for G2."""
    wi, wo = pairs(material, generator)
    surface = bsdf(material, scattering, max_order=1)
    ours = values(surface, wi, wo, generator)
    single = values(bsdf(material, "single"), wi, wo, generator)
    factor = separable(surface, wi, wo) if scattering.endswith("uncorrelated") else 1.0
    theirs = Estimate(single.mean * factor, single.stderr * factor, single.n)
    assert (theirs.mean > 0).double().mean() > 0.4, "glass is dark between most pairs of sides, no more"
    budget(p_value(zscore(ours, theirs, rounding=1e-9 * theirs.mean)))


@each("distribution", ELLIPTIC)
@models(scatterings=[*SCATTERINGS, *COMPENSATIONS], where=lambda m, s: not (transmits(m) and s in COMPENSATIONS))
def test_equal_alphas_are_isotropic(material, scattering, distribution, generator):
    """One α and two that are equal: every order, density, sample and energy, to rounding (that of tables, where there are).

    Compensated glass refuses two numbers, even if they are equal.
    """
    one, two = (bsdf(material, scattering, distribution, alpha, max_order=2) for alpha in ((0.4,), (0.4, 0.4)))
    wi, wo = pairs(material, generator)
    u = one.uniforms((PAIRS,), 2, generator=generator)
    rounding = 1e-6 if scattering in COMPENSATIONS else 1e-9
    for a, b in (
        (one.orders(wi, wo, u), two.orders(wi, wo, u)),
        (one.pdf(wi, wo), two.pdf(wi, wo)),
        (one.sample(wi, u).wo, two.sample(wi, u).wo),
        (one.albedo(wi, u).reflected, two.albedo(wi, u).reflected),
    ):
        torch.testing.assert_close(a, b, rtol=rounding, atol=1e-12)
