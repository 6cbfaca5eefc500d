"""Shadowing and masking on the full sphere."""

import pytest
import scipy.special
import torch
from cases import DISTRIBUTIONS, MATERIALS, TOLERANCES, bsdf, directions, each

from torchms import RoughConductor
from torchms.maths.numerics import smallest
from torchms.paths.masking import G1_dist, G2_dist, G2_mid, escape_transmitted
from torchms.testing import sphere_cells

RTOL, ATOL = TOLERANCES[torch.float64]


def pairs(distribution, generator, n=500):
    """The distribution, and two times `n` directions on the whole sphere."""
    return DISTRIBUTIONS[distribution](torch.tensor(0.8).double(), torch.tensor(0.3).double()), *(
        directions(n, generator) for _ in range(2)
    )


def a_of(model, w):
    """a(w) = |Λ(−w)|, which keeps its digits below the horizon; at least the smallest that divides."""
    return model.Lambda(-w).abs().clamp_min(smallest(torch.float64))


@each("distribution", DISTRIBUTIONS)
def test_G1_is_the_projected_area(distribution, generator):
    """[Wang2022] Eq. 4: ∫ ⟨w, m⟩ D(m) dm = |cos θ| / G1_dist(w), above the horizon and below, by quadrature."""
    model, w, _ = pairs(distribution, generator, 3)
    for one in torch.cat([w, -w]):
        area = one[2].abs() / G1_dist(model, one)
        share = sphere_cells(lambda m: (m @ one).clamp_min(0) * model.D(m) / area, (32, 32), 1e-7).sum()
        assert float(share) == pytest.approx(1, rel=1e-6)


@each("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("transmitted", [False, True])
def test_nothing_is_lost(distribution, transmitted, generator):
    """G2_mid + [d leaves] G2_dist = G1_dist = 1 / |1 + Λ(w)|, neither is negative, all are finite."""
    model, w, d = pairs(distribution, generator)
    a, last, middle = a_of(model, w), G2_dist(model, w, d, transmitted), G2_mid(model, w, d, transmitted)
    leaves = d[:, 2] < 0 if transmitted else d[:, 2] > 0
    assert last.isfinite().all() and middle.isfinite().all()
    assert (last[~leaves] == 0).all() and (last[leaves] > 0).all() and (middle >= 0).all()
    torch.testing.assert_close(a * (middle + last), torch.ones_like(a), rtol=1e-9, atol=ATOL)
    torch.testing.assert_close(a * G1_dist(model, w), torch.ones_like(a), rtol=1e-9, atol=ATOL)


@each("distribution", DISTRIBUTIONS)
def test_G2_is_one_over_the_sum(distribution, generator):
    """[Wang2022] Eq. 12: G2_dist = 1 / (a(w) + Λ(d)); above the horizon the G2 of [Heitz2014] Eq. 99, symmetric."""
    model, w, d = pairs(distribution, generator)
    d = d * d[:, 2:].sign()
    torch.testing.assert_close(G2_dist(model, w, d), 1 / (a_of(model, w) + model.Lambda(d)), rtol=1e-9, atol=ATOL)
    both = w[:, 2] > 0
    torch.testing.assert_close(G2_dist(model, w, d)[both], G2_dist(model, d, w)[both], rtol=RTOL, atol=ATOL)


@each("distribution", DISTRIBUTIONS)
def test_transmission_is_the_beta_function(distribution, generator):
    """G2_dist = B(a(w), 1 + Λ(−d)), from either side."""
    model, w, d = pairs(distribution, generator)
    d = -d * d[:, 2:].sign()
    beta = scipy.special.beta(a_of(model, w).numpy(), 1 + model.Lambda(-d).numpy())
    torch.testing.assert_close(G2_dist(model, w, d, True), torch.from_numpy(beta), rtol=1e-9, atol=0)


def test_escape_into_the_other_side_is_a_probability():
    """a B(a, 1 + Λ) lies in [0, 1] from a, Λ = 1e-20 to 1e12, where lgamma cancels, in either precision."""
    for dtype in TOLERANCES:
        x = torch.cat([torch.zeros(1), torch.logspace(-20, 12, 200, dtype=torch.float64)]).to(dtype)
        p = escape_transmitted(x[:, None], x[None, :])
        assert p.isfinite().all() and (p >= 0).all() and (p <= 1).all()
        assert (p[0] == 1).all()


def test_escape_into_the_other_side_has_its_gradient(generator):
    a, lam = (0.01 + 3 * torch.rand(2, 10, generator=generator, dtype=torch.float64)).requires_grad_().unbind(0)
    assert torch.autograd.gradcheck(escape_transmitted, (a, lam), rtol=1e-6)


@each("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("material", [m for m in MATERIALS if "dielectric" not in m and "diffuse" not in m])
def test_one_order_is_a_single_bounce(material, distribution, generator):
    """K = 1 of Correlated and Invariance is SingleBounce, without random numbers."""
    wi, wo = directions(200, generator, 0.01), directions(200, generator)
    single = bsdf(material, "single", distribution)(wi, wo)
    for scattering in ("correlated", "invariance"):
        torch.testing.assert_close(
            bsdf(material, scattering, distribution, max_order=1)(wi, wo), single, rtol=RTOL, atol=ATOL
        )


@each("distribution", DISTRIBUTIONS)
def test_single_bounce_is_the_textbook(distribution, generator):
    """F D G2 / (4 cos θ_i) from the public pieces, G2 = 1 / (1 + Λ_i + Λ_o)."""
    surface = bsdf("conductor[schlick]", "single", distribution)
    assert isinstance(surface, RoughConductor)
    wi, wo = directions(200, generator, 0.01), directions(200, generator, 0.01)
    h = torch.nn.functional.normalize(wi + wo, dim=-1)
    model = surface.distribution
    G2 = 1 / (1 + model.Lambda(wi) + model.Lambda(wo))
    value = surface.fresnel((wi * h).sum(-1)) * (model.D(h) * G2 / (4 * wi[:, 2]))[:, None]
    torch.testing.assert_close(surface(wi, wo), value, rtol=1e-10, atol=1e-14)
