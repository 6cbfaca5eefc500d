"""A scattering of one's own with weights, the one of CONTRIBUTING.md: it trains, and goes wherever others go."""

import copy
import math
from pathlib import Path

import pytest
import torch
from test_contributing import definitions
from torch import nn

import torchms
from torchms import GGX, Bidirectional, Invariance, RoughConductor, RoughDielectric, Stream
from torchms.fresnel import Conductor, Dielectric, Ideal
from torchms.onnx import Evaluator, export
from torchms.onnx.exporter import checked
from torchms.onnx.parity.eager import eagerly
from torchms.onnx.parity.grid import grid
from torchms.parameters.exchange import parameters, weights
from torchms.sampling.uniforms import generator_for
from torchms.testing import law_suite


def learned(alpha: float | torch.Tensor = 0.7, seed: int = 0) -> RoughConductor:
    torch.manual_seed(seed)
    return RoughConductor(GGX(alpha), Conductor.metal("Cu"), definitions()["LearnedRest"]())


def directions(n: int, seed: int) -> torch.Tensor:
    w = torch.nn.functional.normalize(torch.randn(n, 3, generator=generator_for(seed)), dim=-1)
    return torch.cat([w[:, :2], w[:, 2:].abs()], -1)


def test_its_weights_are_no_parameters_of_the_surface() -> None:
    surface = learned()
    assert list(parameters(surface)) == ["fresnel.eta", "fresnel.k", "distribution.alpha"]
    assert set(weights(surface)) == {f"scattering.network.{i}.{name}" for i in (0, 2) for name in ("weight", "bias")}
    with pytest.raises(ValueError, match="Use it in a RoughConductor"):
        RoughDielectric(GGX(0.5), Dielectric(1.5), definitions()["LearnedRest"]())


def test_it_trains() -> None:
    """Towards the energy of the second order and later ones of a white furnace."""
    wi, wo, alpha = directions(64, 1), directions(64, 2), torch.full((64,), 0.7)
    model = RoughConductor(GGX(alpha), Ideal(), Bidirectional(Invariance(), 4))
    target = model.orders(wi, wo, Stream(3, 64))[:, 1:].sum(1)
    surface = RoughConductor(GGX(alpha), Ideal(), learned().scattering)
    optimizer = torch.optim.Adam(surface.parameters(), lr=0.03)
    losses = []
    for _ in range(60):
        loss = (surface.orders(wi, wo)[:, 1] - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        assert all(p.grad is not None and bool(p.grad.isfinite().all()) for p in surface.parameters())
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.2 * losses[0]


def test_the_laws_do_not_touch_what_is_trained() -> None:
    """Nor do they need its graphs: weights that another network gave are tried as they are."""
    surface = learned()
    network = surface.scattering.get_submodule("network")
    last = network.get_submodule("2")
    before = copy.deepcopy(network.state_dict())
    given = 1.0 * last.get_parameter("bias")
    del last.bias
    last.register_buffer("bias", given)
    assert not law_suite(surface, samples=2000).failed
    assert last.bias is given and all(p.requires_grad for p in network.parameters())
    assert all(torch.equal(network.state_dict()[name], value) for name, value in before.items() if name != "2.bias")


def test_the_laws_see_its_weights() -> None:
    """A network whose gradient is not finite, although its values are, is found."""

    class Root(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight = nn.Parameter(torch.zeros(()))

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return 0.5 + self.weight.sqrt() + 0 * x

    surface = learned()
    surface.scattering.network = nn.Sequential(nn.Linear(2, 1), Root())
    failed = law_suite(surface, samples=1000).failed
    assert failed and all("finite" in law.name and "scattering.network.1.weight" in law.note for law in failed)


def test_the_reference_of_its_exported_file_is_float64_throughout() -> None:
    graph = checked(learned(), "orders", ("alpha",), "input", 1)
    inputs = grid(graph, 50)
    single, double = eagerly(graph, inputs), eagerly(graph, inputs, torch.float64)
    assert double.dtype == torch.float64 and single.dtype == torch.float32
    exact = learned().double().scattering.get_submodule("network")
    x = torch.rand(9, 2, dtype=torch.float64)
    substituted = graph.substituted(inputs, torch.float64).scattering.get_submodule("network")
    assert torch.equal(substituted(x), exact(x))
    assert float((double[:, 1] - single[:, 1]).abs().max()) < 1e-6


@pytest.mark.slow
def test_it_is_exported(tmp_path: Path) -> None:
    """With the weights in the file, which keeps the bounds of the check."""
    surface = learned()
    evaluator = Evaluator(export(surface, tmp_path / "learned.onnx", parameters=("alpha",)))
    wi, wo = directions(50, 1), directions(50, 2)
    torch.testing.assert_close(evaluator(wi, wo, alpha=0.7), surface(wi, wo).detach(), rtol=1e-4, atol=1e-6)
    assert math.isfinite(float(evaluator(wi, wo, alpha=0.2).sum()))


def test_one_program_serves_all_steps_of_its_training() -> None:
    """Weights are inputs of compiled code: a step changes its results, as it does the eager ones, and compiles nothing."""
    surface, wi, wo = learned(), directions(40, 1), directions(40, 2)
    fast = torchms.compile(surface, verbose=False)
    optimizer = torch.optim.SGD(surface.scattering.parameters(), lr=5.0)
    programs, values = set(), []
    for _ in range(3):
        gradients = []
        for each in (fast, surface):
            value = each(wi, wo)
            gradients.append(torch.autograd.grad(value.square().mean(), list(surface.parameters())))
        values.append(fast(wi, wo).detach())
        torch.testing.assert_close(values[-1], surface(wi, wo).detach(), rtol=1e-4, atol=1e-6)
        for a, b in zip(*gradients, strict=True):
            torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4 * float(b.abs().max()))
        for parameter, gradient in zip(surface.parameters(), gradients[0], strict=True):
            parameter.grad = gradient
        optimizer.step()
        programs.add(len(fast.engine.compiled) if fast.engine is not None else 0)
    assert len(programs) == 1 and float((values[0] - values[-1]).abs().max()) > 1e-4
