"""The special functions against mpmath: values, gradients, ends; their tables against the generator."""

import math
import pathlib

import pytest
import torch
from torch import Tensor

from tools import generate_special
from torchms.maths import special

mp = pytest.importorskip("mpmath", reason="needs mpmath (pip install mpmath)")

DTYPES = [torch.float32, torch.float64]
F64 = torch.float64


def reference(function, *arguments: Tensor) -> Tensor:
    """`function` of mpmath numbers at the exact values of the tensors, in float64."""
    with mp.workdps(50):
        rows = zip(*(x.detach().double().tolist() for x in arguments), strict=True)
        return torch.tensor([float(function(*map(mp.mpf, row))) for row in rows], dtype=F64)


def relative_error(value: Tensor, exact: Tensor) -> float:
    return float(((value.detach().double() - exact).abs() / exact.abs()).max())


def half_line(dtype: torch.dtype) -> Tensor:
    return torch.cat([torch.zeros(1), torch.logspace(-6, 4, 120), torch.linspace(0.05, 12, 120)]).to(dtype)


def erfinv_exact(y):
    return mp.sign(y) * generate_special.erfinv_ratio(-mp.log1p(-y * y)) * abs(y) if abs(y) > 1e-9 else mp.erfinv(y)


def beta_step(a, b):
    return mp.loggamma(a + 1) + mp.loggamma(b + 1) - mp.loggamma(a + b + 1)


@pytest.mark.parametrize(
    ("dtype", "value", "slope"), [(torch.float32, 6e-7, 2e-6), (torch.float64, 5e-15, 1e-13)], ids=["f32", "f64"]
)
def test_erfcx_and_its_integral(dtype, value, slope):
    x = half_line(dtype).requires_grad_()
    pair = special.erfcx_pair(x)
    assert torch.equal(pair[0], special.erfcx(x)) and torch.equal(pair[1], special.ierfcx(x))
    exact = reference(generate_special.erfcx, x), reference(generate_special.ierfcx, x)
    # erfcx' = −2 ierfcx and ierfcx' = 2 x ierfcx − erfcx.
    slopes = (
        -2 * exact[1],
        reference(lambda t: 2 * t * generate_special.ierfcx(t) - generate_special.erfcx(t), x),
    )
    for i in range(2):
        assert relative_error(pair[i], exact[i]) < value
        (gradient,) = torch.autograd.grad(pair[i].sum(), x, retain_graph=True)
        assert relative_error(gradient, slopes[i]) < slope
    far = special.erfcx_pair(torch.tensor([1e15, math.inf], dtype=dtype))
    assert all(part.isfinite().all() and (part >= 0).all() for part in far)


@pytest.mark.parametrize("dtype", DTYPES)
def test_error_functions_of_either_sign(dtype):
    x = torch.linspace(-5, 5, 41, dtype=dtype)
    tolerance = {torch.float32: 1e-5, torch.float64: 1e-13}[dtype]
    assert relative_error(special.erfc(x), reference(mp.erfc, x)) < tolerance
    assert float((special.erf(x).double() - reference(mp.erf, x)).abs().max()) < tolerance


@pytest.mark.parametrize(
    ("dtype", "value", "slope"), [(torch.float32, 5e-7, 5e-6), (torch.float64, 1e-13, 2e-12)], ids=["f32", "f64"]
)
def test_erfinv(dtype, value, slope):
    last = -7 if dtype == torch.float32 else -15
    near_one = 1 - torch.logspace(last, -1, 60, dtype=F64)
    y = torch.cat([near_one, -near_one, torch.linspace(-0.9, 0.9, 60), torch.logspace(-20, -1, 40)]).to(dtype)
    y.requires_grad_()
    exact = reference(erfinv_exact, y)
    x = special.erfinv(y)
    assert relative_error(x, exact) < value
    (gradient,) = torch.autograd.grad(x.sum(), y)
    assert relative_error(gradient, math.sqrt(math.pi) / 2 * torch.exp(exact * exact)) < slope


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("function", [special.erfinv, special.normal_quantile])
def test_quantiles_are_finite_at_the_ends(dtype, function):
    eps = torch.finfo(dtype).eps
    y = torch.tensor([-1.0 if function is special.erfinv else 0.0, 0.0, 0.5, 1 - eps / 2, 1.0], dtype=dtype)
    y.requires_grad_()
    x = function(y)
    (gradient,) = torch.autograd.grad(x.sum(), y)
    assert x.isfinite().all() and gradient.isfinite().all() and (x.diff() >= 0).all()


@pytest.mark.parametrize("dtype", DTYPES)
def test_normal_quantile_keeps_small_u(dtype):
    u = torch.logspace(-7 if dtype == torch.float32 else -15, -0.31, 60, dtype=F64).to(dtype)
    # erfc(−x) / 2 = u, relative to u: 2u − 1 has lost it.
    mass = reference(mp.erfc, -special.normal_quantile(u)) / 2
    assert relative_error(mass, u.double()) < {torch.float32: 2e-5, torch.float64: 1e-12}[dtype]


@pytest.mark.parametrize(("dtype", "value"), [(torch.float32, 2e-6), (torch.float64, 1e-13)], ids=["f32", "f64"])
def test_log_beta_step(dtype, value, generator):
    exponents = torch.rand(2, 300, generator=generator, dtype=F64) * 14 - 6
    corner = torch.tensor([0.0, 1.0, 1e8], dtype=F64)
    pairs = torch.cat([10**exponents, torch.cartesian_prod(corner, corner).T], dim=1).to(dtype)
    a, b = (row.clone().requires_grad_() for row in pairs)
    exact = reference(lambda p, q: mp.exp(beta_step(p, q)), a, b)
    step = special.log_beta_step(a, b)
    assert float((step.detach().exp().double() - exact).abs().max()) < value
    assert torch.equal(step, special.log_beta_step(b, a))
    assert (step <= value).all() and step.isfinite().all()
    # d/da exp(step) = exp(step) (ψ(a + 1) − ψ(a + b + 1)).
    slope = reference(lambda p, q: mp.exp(beta_step(p, q)) * (mp.digamma(p + 1) - mp.digamma(p + q + 1)), a, b)
    gradients = torch.autograd.grad(step.exp().sum(), (a, b))
    assert all(g.isfinite().all() for g in gradients)
    error = (gradients[0].double() - slope).abs() / (slope.abs() + 1e-3)
    assert float(error.max()) < {torch.float32: 1e-3, torch.float64: 1e-10}[dtype]


@pytest.mark.parametrize(("dtype", "value"), [(torch.float32, 1e-6), (torch.float64, 5e-12)], ids=["f32", "f64"])
def test_log_beta_step_of_a_small_argument(dtype, value, generator):
    """Relative to itself, which 1 − a B(a, 1 + b), the probability to stay, inherits: smooth glass rarely blocks light."""
    low = 10 ** (torch.rand(300, generator=generator, dtype=F64) * 5 - 6)
    high = 10 ** (torch.rand(300, generator=generator, dtype=F64) * 3 - 0.3)
    low, high = low.to(dtype), high.to(dtype)
    assert relative_error(special.log_beta_step(high, low), reference(beta_step, low, high)) < value


def test_escape_probability_of_one_crossing():
    # a B(a, 1 + Λ) at integers: a! Λ! / (a + Λ)!.
    a, b = torch.tensor([1.0, 2.0, 3.0], dtype=F64), torch.tensor([1.0, 3.0, 2.0], dtype=F64)
    torch.testing.assert_close(special.log_beta_step(a, b).exp(), torch.tensor([1 / 2, 1 / 10, 1 / 10], dtype=F64))


@pytest.mark.parametrize("function", [special.erfcx, special.ierfcx, special.erf, special.erfc, special.erfinv])
def test_first_and_second_derivatives(function):
    x = torch.tensor([0.01, 0.2, 0.5, 0.9], dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(function, (x,))
    assert torch.autograd.gradgradcheck(function, (x,))


def test_derivatives_of_log_beta_step():
    a = torch.tensor([0.0, 0.3, 2.0, 40.0], dtype=F64, requires_grad=True)
    b = torch.tensor([1.5, 0.0, 2.0, 0.1], dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p, q: special.log_beta_step(p + 1e-3, q + 1e-3), (a, b))
    assert torch.autograd.gradgradcheck(lambda p, q: special.log_beta_step(p + 1e-3, q + 1e-3), (a, b))


def test_tables_are_what_the_generator_gives():
    source = pathlib.Path(special.__file__).read_text(encoding="utf-8")
    assert generate_special.tables() in source


def test_no_coefficient_is_small_enough_for_the_onnx_optimizer_to_drop():
    # onnxscript's rewriter takes `+ c` with |c| < 1e-8 for `+ 0`.
    for table in (special.ERFCX, special.IERFCX, special.STIRLING, special.ERFINV):
        for coefficients in table.values():
            assert min(map(abs, coefficients)) > 1e-7


def test_other_dtypes_are_refused():
    with pytest.raises(TypeError, match=r"float32 or float64; got torch\.float16"):
        special.erfcx(torch.ones(1, dtype=torch.float16))
