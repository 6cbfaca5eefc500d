"""Guarded scalar functions: exact values, and gradients that stay finite where the plain ones are not."""

import math

import pytest
import torch

from torchms.maths import numerics

DTYPES = [torch.float32, torch.float64]
F64 = torch.float64


def gradient(function, x):
    x = x.clone().requires_grad_()
    y = function(x)
    return y.detach(), torch.autograd.grad(y.sum(), x)[0]


@pytest.mark.parametrize("dtype", DTYPES)
def test_safe_sqrt(dtype):
    value, slope = gradient(numerics.safe_sqrt, torch.tensor([-1.0, 0.0, 4.0], dtype=dtype))
    assert value.tolist() == [0, 0, 2] and slope.tolist() == [0, 0, 0.25]


@pytest.mark.parametrize("dtype", DTYPES)
def test_safe_div(dtype):
    value, slope = gradient(lambda b: numerics.safe_div(torch.ones_like(b), b), torch.tensor([0.0, 2.0], dtype=dtype))
    assert value.tolist() == [0, 0.5] and slope.tolist() == [0, -0.25]


def test_away_from_zero_keeps_the_sign():
    value, slope = gradient(lambda x: numerics.away_from_zero(x, 0.1), torch.tensor([-1.0, -0.01, 0.0, 0.01, 1.0]))
    torch.testing.assert_close(value, torch.tensor([-1.0, -0.1, 0.1, 0.1, 1.0]))
    assert slope.tolist() == [1, 0, 0, 0, 1]


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 3e-7), (torch.float64, 1e-15)])
def test_log1p_and_expm1_are_accurate_near_zero(dtype, tolerance):
    x = torch.cat([torch.zeros(1, dtype=F64), torch.logspace(-20, 8, 200, dtype=F64)]).to(dtype)
    value, slope = gradient(numerics.log1p, x)
    torch.testing.assert_close(value.double(), torch.log1p(x.double()), rtol=tolerance, atol=0)
    torch.testing.assert_close(slope.double(), 1 / (1 + x.double()), rtol=20 * tolerance, atol=0)
    x = -x[x < 50]
    value, slope = gradient(numerics.expm1, x)
    torch.testing.assert_close(value.double(), torch.expm1(x.double()), rtol=tolerance, atol=0)
    torch.testing.assert_close(slope.double(), torch.exp(x.double()), rtol=20 * tolerance, atol=0)


def test_log1p_of_negative_arguments():
    x = torch.tensor([-1e-12, -0.3, -0.999], dtype=F64)
    torch.testing.assert_close(numerics.log1p(x), torch.log1p(x), rtol=1e-14, atol=0)


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_least_numbers_survive_their_use(dtype):
    # A reciprocal and its gradient of the least radicand, and the square of the least cosine, are normal numbers.
    tiny = torch.finfo(dtype).tiny
    assert tiny < numerics.smallest(dtype) and 1 / numerics.smallest(dtype) < torch.finfo(dtype).max
    assert numerics.horizon(dtype) ** 2 > tiny
    assert math.isfinite(numerics.horizon(dtype))
