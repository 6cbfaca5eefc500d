"""Second derivatives where they exist: closed forms in float64, against differences of their gradients."""

import pytest
import torch
from cases import COMPENSATIONS, DISTRIBUTIONS, ELLIPTIC, direction, each
from torch import Tensor
from torch.autograd import gradgradcheck

from torchms import RoughConductor, RoughDielectric, SingleBounce
from torchms.fresnel import Conductor, Dielectric, Schlick

DIRECTIONS = {"steep": direction(0.3), "grazing": direction(1.4, 2.0), "below": direction(2.2, -1.0)}


def leaves(*values: float | list[float]) -> list[Tensor]:
    return [torch.tensor(v, dtype=torch.float64).requires_grad_() for v in values]


@each("distribution", DISTRIBUTIONS)
@each("where", DIRECTIONS)
def test_distribution(distribution, where):
    """D above the horizon and Λ on the whole sphere, in both α and the direction."""
    w = DIRECTIONS[where].clone().requires_grad_()
    family = DISTRIBUTIONS[distribution]

    def both(ax: Tensor, ay: Tensor, w: Tensor) -> tuple[Tensor, ...]:
        facets = family(ax, ay)
        return (facets.D(w), facets.Lambda(w)) if where != "below" else (facets.Lambda(w),)

    assert gradgradcheck(both, (*leaves(0.6, 0.35), w), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("cos_theta", [1.0, 0.7, 0.1])
def test_fresnel(cos_theta):
    c = torch.tensor(cos_theta, dtype=torch.float64)
    assert gradgradcheck(lambda eta, k: Conductor(eta, k)(c), tuple(leaves([0.4, 1.2], [3.0, 2.0])))
    assert gradgradcheck(lambda eta: Dielectric(eta)(c), tuple(leaves(1.5)))
    assert gradgradcheck(lambda f0: Schlick(f0)(c), tuple(leaves([0.1, 0.8])))


@each("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("side", [1, -1])
def test_single_bounce(distribution, side):
    """forward of a metal, and of glass back and through, in α, η, k and both directions."""
    wi, wo = direction(0.6).requires_grad_(), direction(0.9, 2.5).requires_grad_()
    family = DISTRIBUTIONS[distribution]

    def metal(ax: Tensor, ay: Tensor, eta: Tensor, k: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        return RoughConductor(family(ax, ay), Conductor(eta, k), SingleBounce())(wi, wo)

    def glass(ax: Tensor, ay: Tensor, eta: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        return RoughDielectric(family(ax, ay), Dielectric(eta), SingleBounce())(wi, side * wo)

    if side == 1:
        assert gradgradcheck(metal, (*leaves(0.6, 0.35, [0.4], [3.0]), wi, wo), atol=1e-5, rtol=1e-4)
    assert gradgradcheck(glass, (*leaves(0.6, 0.35, 1.5), wi, wo), atol=1e-5, rtol=1e-4)


@each("scattering", COMPENSATIONS)
@each("distribution", ELLIPTIC)
def test_compensations(scattering, distribution):
    """forward of a metal in α, η, k and both directions: polynomials of a table."""
    wi, wo = direction(0.6).requires_grad_(), direction(0.9, 2.5).requires_grad_()
    model, family = COMPENSATIONS[scattering](2).double(), DISTRIBUTIONS[distribution]

    def metal(ax: Tensor, ay: Tensor, eta: Tensor, k: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        return RoughConductor(family(ax, ay), Conductor(eta, k), model)(wi, wo)

    assert gradgradcheck(metal, (*leaves(0.6, 0.35, [0.4], [3.0]), wi, wo), atol=1e-5, rtol=1e-4)
