"""Bounded visible normals of GGX: their density, what they leave out, and what they are for."""

import math

import pytest
import torch
from cases import direction

from torchms import GGX, RoughConductor, SingleBounce
from torchms.fresnel import Ideal
from torchms.testing import chi_square, sphere_cells

F64 = torch.float64
ALPHAS = [(0.3,), (1.0,), (0.2, 0.9), (2.0, 1.5)]


def ggx(alpha: tuple[float, ...]) -> GGX:
    return GGX(*(torch.tensor(a, dtype=F64) for a in alpha))


def reflections(surface: GGX, w: torch.Tensor, m: torch.Tensor) -> torch.Tensor:
    return 2 * (m @ w)[:, None] * m - w


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", [0.0, 0.7, 1.5, 1.6, 2.2])
def test_bounded_normals_have_their_density(alpha, theta, generator, budget):
    surface, w = ggx(alpha), direction(theta)
    m = surface.sample_bounded(w, torch.rand(60_000, 2, generator=generator, dtype=F64))
    assert (surface.D_bounded(w, m) > 0).all()
    # chi_square also asserts that the density is normalised.
    budget(torch.tensor([chi_square(m, lambda m: surface.D_bounded(w, m), (24, 24), 1e-3)]))


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", [0.3, 1.0, 1.5])
def test_every_normal_that_reflects_upward_is_kept(alpha, theta, generator):
    surface, w = ggx(alpha), direction(theta)
    u = torch.rand(50_000, 2, generator=generator, dtype=F64)
    plain, bounded = surface.sample_visible(w, u), surface.sample_bounded(w, u)
    upward = plain[reflections(surface, w, plain)[:, 2] > 0]
    density = surface.D_bounded(w, upward)
    assert (density >= surface.D_visible(w, upward) * (1 - 1e-12)).all()
    lost = [(reflections(surface, w, m)[:, 2] <= 0).double().mean() for m in (plain, bounded)]
    assert lost[1] <= lost[0] + 1e-3
    if alpha == (1.0,):
        assert lost[1] == 0 and lost[0] > 0.05


def test_below_the_horizon_they_are_the_visible_normals(generator):
    surface, w = ggx((0.2, 0.9)), direction(2.0)
    u = torch.rand(100, 2, generator=generator, dtype=F64)
    m = surface.sample_visible(w, u)
    assert torch.equal(surface.sample_bounded(w, u), m)
    torch.testing.assert_close(surface.D_bounded(w, m), surface.D_visible(w, m), rtol=1e-12, atol=0)


def test_gradients_are_those_of_finite_differences():
    u = torch.tensor([[0.3, 0.6], [0.9, 0.1]], dtype=F64)
    a, b = (torch.tensor(x, dtype=F64, requires_grad=True) for x in (0.4, 0.7))
    for theta in (0.3, 1.4, 1.9):
        w = direction(theta).requires_grad_()
        assert torch.autograd.gradcheck(lambda w, a, b: GGX(a, b).sample_bounded(w, u), (w, a, b), eps=1e-7, atol=1e-5)
        m = direction(0.2, 2.0)
        assert torch.autograd.gradcheck(lambda w, a, b: GGX(a, b).D_bounded(w, m), (w, a, b), eps=1e-7, atol=1e-5)


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_value_and_gradient_are_finite_at_the_edges(dtype):
    last = 1 - torch.finfo(dtype).eps / 2
    for theta in (0.0, 1e-5, math.pi / 2, 3.0, math.pi):
        for number in (0.0, 0.4, last):
            leaves = [direction(theta, dtype=dtype), torch.tensor(1e-3, dtype=dtype), torch.tensor(2.0, dtype=dtype)]
            w, a, b = (x.requires_grad_() for x in leaves)
            surface = GGX(a, b)
            m = surface.sample_bounded(w, torch.full((2,), number, dtype=dtype))
            value = m.sum() + surface.D_bounded(w, m.detach())
            assert value.isfinite()
            assert all(g.isfinite().all() for g in torch.autograd.grad(value, (w, a, b)))


@pytest.mark.parametrize("alpha", [(0.5,), (1.0,), (0.2, 0.9)], ids=str)
@pytest.mark.parametrize("theta", [0.2, 1.0, 1.5])
def test_a_conductor_samples_by_them_with_an_exact_pdf(alpha, theta, generator, budget):
    surface = RoughConductor(ggx(alpha), Ideal(), SingleBounce())
    wi = direction(theta)
    wo, pdf = surface.sample(wi, surface.uniforms((), 60_000, generator=generator))
    assert (pdf > 0).all() and (wo[:, 2] >= 0).all()
    torch.testing.assert_close(surface.pdf(wi, wo), pdf)

    def density(wo: torch.Tensor) -> torch.Tensor:
        return surface.pdf(wi, wo)

    assert float(sphere_cells(density, (24, 24), 1e-3).sum()) == pytest.approx(1, abs=1e-3)
    budget(torch.tensor([chi_square(wo, density, (24, 24), 1e-3)]))
