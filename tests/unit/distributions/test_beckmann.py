"""Beckmann's visible slopes: the error of the inverse function, its gradient, the pole, and the exported sampler."""

import math
import subprocess
import sys

import numpy as np
import pytest
import scipy.special
import torch
from torch import Tensor, nn

from torchms.distributions import Beckmann, gaussian_slopes

F64 = torch.float64
# Largest quantile of u in [0, 1): that of eps / 4 from either end.
LAST = {torch.float32: 3.83, torch.float64: 5.86}


def cotangents(dtype: torch.dtype) -> Tensor:
    return torch.cat([-torch.logspace(1.7, -4, 60), torch.zeros(1), torch.logspace(-4, 6, 120)]).to(dtype)


def slopes_and_error(kappa: Tensor, gauss: Tensor) -> tuple[Tensor, Tensor]:
    """`visible_slope` and |F(x) / F(κ) − Φ| in float64, for the exact κ and Φ of the rounded arguments."""
    theta = torch.atan2(torch.ones_like(kappa).double(), kappa.double())
    rho, z = torch.sin(theta).to(kappa.dtype), torch.cos(theta).to(kappa.dtype)
    x = gaussian_slopes.visible_slope(gauss, rho, z)
    k, x64 = (z.double() / rho.double()).numpy(), x.double().numpy()
    k, x64 = np.broadcast_arrays(k, x64)
    # F(x) e^{κ²} = ∫_{−∞}^x (κ − s) e^{κ² − s²} ds, for κ < 0, and F(x) else; its forms that do not cancel.
    erfcx = scipy.special.erfcx
    shift = np.where(k < 0, k * k - x64 * x64, -x64 * x64)

    def ierfcx(t: np.ndarray) -> np.ndarray:
        return np.where(t < 10, 1 / math.sqrt(math.pi) - t * erfcx(t), quad_tail(t))

    root = math.sqrt(math.pi) / 2
    below = root * np.exp(shift) * ((k - x64) * erfcx(np.abs(x64)) + ierfcx(np.abs(x64)))
    above = root * k * (1 + scipy.special.erf(x64)) + np.exp(-x64 * x64) / 2
    kp = np.maximum(k, 0)
    whole = np.where(k < 0, root * ierfcx(np.abs(k)), root * kp * (1 + scipy.special.erf(kp)) + np.exp(-kp * kp) / 2)
    cdf = np.where(x64 < 0, below, above) / whole
    return x, torch.from_numpy(np.abs(cdf - scipy.special.erfc(-gauss.double().numpy()) / 2))


def quad_tail(t: np.ndarray) -> np.ndarray:
    """1 / √π − t erfcx(t) for t ≥ 10: the asymptotic series."""
    t = np.maximum(t, 10.0)
    s, term = np.zeros_like(t), np.ones_like(t)
    for n in range(1, 18):
        term = term * -(2 * n - 1) / (2 * t * t)
        s -= term
    return s / math.sqrt(math.pi)


@pytest.mark.parametrize(
    ("dtype", "tolerance"), [(torch.float32, 1.5e-6), (torch.float64, 1e-12)], ids=["float32", "float64"]
)
def test_the_inverse_is_exact(dtype, tolerance):
    gauss = torch.linspace(-LAST[dtype], LAST[dtype], 401, dtype=dtype)[:, None]
    kappa = cotangents(dtype)
    x, error = slopes_and_error(kappa, gauss)
    # x itself is rounded: from steeply below, where all slopes are close to κ, that moves F by (F'/F) κ eps ~ 2 κ² eps.
    rounding = 2 * kappa.double().clamp_max(0) ** 2 * torch.finfo(dtype).eps
    assert float((error - rounding).max()) < tolerance
    # Visible, and in order; near x = κ, where F is flat, x is known to √eps.
    unit = 4 * math.sqrt(torch.finfo(dtype).eps) * (1 + kappa.abs())
    assert (x <= kappa + unit).all() and (x.diff(dim=0) >= -unit).all()


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_more_steps_change_nothing(dtype, monkeypatch):
    gauss = torch.linspace(-LAST[dtype], LAST[dtype], 201, dtype=dtype)[:, None]
    kappa = cotangents(dtype)
    _, error = slopes_and_error(kappa, gauss)
    monkeypatch.setitem(gaussian_slopes.STEPS, dtype, gaussian_slopes.STEPS[dtype] + 2)
    _, more = slopes_and_error(kappa, gauss)
    # What is left is rounding: κ² eps.
    unit = torch.finfo(dtype).eps * (8 + 2 * kappa.double().clamp_max(0) ** 2)
    assert float((error / unit).max()) < 2 * float((more / unit).max()) + 1


def test_the_gradient_is_that_of_the_inverse():
    gauss = torch.tensor([-5.5, -2.0, -0.3, 0.4, 2.5, 3.0], dtype=F64)[:, None].requires_grad_()
    theta = torch.tensor([1e-4, 0.3, 0.8, 1.5, math.pi / 2, 1.7, 2.3, 2.9], dtype=F64)
    rho, z = torch.sin(theta).requires_grad_(), torch.cos(theta).requires_grad_()
    assert torch.autograd.gradcheck(gaussian_slopes.visible_slope, (gauss, rho, z), eps=1e-7, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_the_sampler_is_smooth_at_the_pole(dtype, generator):
    """Neither value nor gradient depends on the azimuth from which w approaches normal incidence."""
    distribution = Beckmann(torch.tensor(0.4, dtype=dtype), torch.tensor(0.9, dtype=dtype))
    u = torch.rand(50, 2, generator=generator, dtype=dtype)
    phi = torch.linspace(0, 6, 9, dtype=dtype)[:, None]
    eps = torch.finfo(dtype).eps

    def at(theta: float) -> tuple[Tensor, Tensor]:
        sin = math.sin(theta) * torch.ones_like(phi)
        w = torch.stack([sin * torch.cos(phi), sin * torch.sin(phi), (1 - sin * sin).sqrt()], -1).requires_grad_()
        # Each view's own gradient: that of the sum over its samples.
        m = distribution.sample_visible(w, u)
        return m.detach(), torch.autograd.grad(m.sum(), w)[0]

    pole, pole_gradient = at(0.0)
    # On either side of the angle at which the linear form takes over, 0.3 √eps.
    for theta in (eps, 0.1 * math.sqrt(eps), 10 * math.sqrt(eps)):
        m, gradient = at(theta)
        assert float((m - pole).abs().max()) < 2 * theta + 8 * eps
        scale = float(pole_gradient.abs().max())
        assert float((gradient - pole_gradient)[..., :2].abs().max()) < (20 * theta + 100 * math.sqrt(eps)) * scale


def test_the_density_does_not_underflow_below_the_horizon(generator):
    # cot θ / α = −15: D and σ are e^{−225}, beyond float32.
    theta = math.pi - math.atan(1 / 1.5)
    w = torch.tensor([math.sin(theta), 0, math.cos(theta)], dtype=F64)
    u = torch.rand(1000, 2, generator=generator, dtype=F64)
    exact = Beckmann(torch.tensor(0.1, dtype=F64))
    m = exact.sample_visible(w, u)
    density = exact.D_visible(w, m)
    assert (density > 0).all()
    single = Beckmann(0.1)
    assert float(single.Lambda(-w.float())) == 0
    ratio = single.D_visible(w.float(), m.float()).double() / density
    # ⟨w, m⟩ and the difference of two exponents of 225 have lost digits.
    assert float((ratio - 1).abs().median()) < 2e-4


class Sampler(nn.Module):
    def __init__(self, dtype: torch.dtype) -> None:
        super().__init__()
        self.distribution = Beckmann(torch.tensor(0.5, dtype=dtype), torch.tensor(0.8, dtype=dtype))

    def forward(self, w: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        d = self.distribution
        m = d.sample_visible(w, u)
        return m, d.Lambda(w), d.D_visible(w, m)


def batch(dtype: torch.dtype, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    w = nn.functional.normalize(torch.randn(500, 3, generator=generator, dtype=dtype), dim=-1)
    return w, torch.rand(500, 2, generator=generator, dtype=dtype)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dtype", "tolerance"), [(torch.float32, 2e-5), (torch.float64, 1e-12)], ids=["float32", "float64"]
)
def test_onnx_parity(dtype, tolerance, generator):
    ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime (pip install torchms[onnx])")
    module, inputs = Sampler(dtype).eval(), batch(dtype, generator)
    program = torch.onnx.export(module, inputs, dynamo=True, verbose=False)
    assert program is not None
    session = ort.InferenceSession(program.model_proto.SerializeToString(), providers=["CPUExecutionProvider"])
    outputs = session.run(None, {i.name: x.numpy() for i, x in zip(session.get_inputs(), inputs, strict=True)})
    with torch.no_grad():
        eager = module(*inputs)
    steep = inputs[0][:, 2] > -0.5
    for ours, theirs in zip(eager, outputs, strict=True):
        torch.testing.assert_close(ours[steep], torch.from_numpy(theirs)[steep], rtol=tolerance, atol=tolerance)


COMPILED = """
import torch
from torchms.distributions import Beckmann
g = torch.Generator().manual_seed(1)
w = torch.nn.functional.normalize(torch.randn(1000, 3, generator=g), dim=-1)
u = torch.rand(1000, 2, generator=g)
d = Beckmann(0.5, 0.8)
sample = torch.compile(d.sample_visible, fullgraph=True, backend="aot_eager")
torch.testing.assert_close(sample(w, u), d.sample_visible(w, u), rtol=1e-5, atol=1e-5)
"""


@pytest.mark.slow
def test_the_sampler_is_one_graph():
    # In a process of its own: the run-time type checks of this one would break the graph.
    done = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
