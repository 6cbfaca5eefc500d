"""What is held stays where it is; what moves with the knots keeps its order and its solid angle is accounted for."""

import pytest
import torch
from cases import MATERIALS, direction, directions
from torch import Tensor

from torchms import GGX, Bidirectional, HeightWalk, Invariance, Unidirectional
from torchms.maths.frame import Vec3, split
from torchms.maths.numerics import score
from torchms.paths.detached import detached


def knots(low: Tensor, high: Tensor) -> tuple[Tensor, ...]:
    one = torch.ones_like(low)
    return -one, low, high, one


def test_score_is_one_with_the_gradient_of_the_logarithm():
    p = torch.tensor([0.2, 3.0, 1e-12, 0.0], dtype=torch.float64, requires_grad=True)
    value = score(p)
    torch.testing.assert_close(value, torch.ones_like(p))
    (gradient,) = torch.autograd.grad(value.sum(), p)
    torch.testing.assert_close(gradient, torch.tensor([5.0, 1 / 3, 1e12, 0.0], dtype=torch.float64))


def test_nothing_moves_without_knots_that_move(generator):
    d = directions(50, generator).requires_grad_()
    held, growth = detached(split(d), ())
    assert growth is None and not any(x.requires_grad for x in held)
    torch.testing.assert_close(torch.stack(held, -1), d.detach())


@pytest.mark.parametrize("n", [None, 1.5, -1.5])
def test_moves_with_the_knots(n, generator):
    """At the values themselves nothing changes; the derivative is that of the map between the knots, which keeps |d| = 1."""
    d = split(directions(200, generator))
    low, high = (torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (-0.6, 0.3))
    index = None if n is None else torch.tensor(n, dtype=torch.float64)
    outer = torch.tensor(1.5, dtype=torch.float64)
    ends = knots(low, high) if n is None else (*knots(low, high), -outer, outer)
    held, growth = detached(d, ends, index)
    assert growth is not None
    torch.testing.assert_close(torch.stack(held, -1).detach(), torch.stack(d, -1))
    torch.testing.assert_close(growth.detach(), torch.ones_like(growth))
    for i in range(0, 200, 10):
        height = float(d.z[i]) * (1 if n is None else n)
        (dz, dg) = (torch.autograd.grad(x[i], (low, high), retain_graph=True) for x in (held.z, growth))
        length2 = held.x[i] ** 2 + held.y[i] ** 2 + held.z[i] ** 2
        for g in torch.autograd.grad(length2, (low, high), retain_graph=True):
            assert abs(float(g)) < 1e-12
        # Between the two: z' = low' + t (high' − low'), and the solid angle grows by the same share everywhere.
        if -0.6 < height < 0.3:
            t = (height + 0.6) / 0.9
            expected = torch.tensor([1 - t, t]) / (1 if n is None else n)
            torch.testing.assert_close(torch.stack(dz), expected.double())
            torch.testing.assert_close(torch.stack(dg), torch.tensor([-1 / 0.9, 1 / 0.9], dtype=torch.float64))


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_finite_at_the_poles_and_on_a_knot(pole):
    low = torch.tensor([pole, 0.0, -1.0], dtype=torch.float64, requires_grad=True)
    d = Vec3(*torch.tensor([[0.0] * 3, [0.0] * 3, [pole] * 3], dtype=torch.float64))
    held, growth = detached(d, knots(low, low.detach() + 0.5))
    assert growth is not None
    (gradient,) = torch.autograd.grad((held.x + held.z + growth).sum(), low)
    assert gradient.isfinite().all()


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize("build", [lambda a: Unidirectional(Invariance(), 3, a), lambda a: HeightWalk(3, a)])
def test_attached_is_a_flag(build):
    assert [build(a).attached for a in (None, True, False)] == [None, True, False]
    with pytest.raises(TypeError, match=r"attached=\.\.\.\) must be True, False or None; got 1"):
        build(1)


@pytest.mark.parametrize("estimator", [HeightWalk, lambda k, a: Bidirectional(Invariance(), k, a)])
def test_values_do_not_depend_on_it(estimator, generator):
    """Holding changes gradients, not values."""

    wi, wo = direction(0.7), direction(0.9, 2.0)
    values = []
    for attached in (None, True, False):
        alpha = torch.tensor(0.6, dtype=torch.float64, requires_grad=True)
        surface = MATERIALS["conductor[schlick]"](GGX(alpha, 0.3), estimator(3, attached)).to(torch.float64)
        u = surface.uniforms((), 8, generator=torch.Generator().manual_seed(1))
        values.append(surface(wi, wo, u))
    torch.testing.assert_close(values[1], values[0])
    torch.testing.assert_close(values[2], values[0])
