"""Parameters and weights by name: found in any part, sliced with the rows, replaced in a copy."""

from collections.abc import Sequence

import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils import parametrize

from torchms import GGX, GTR, KullaConty, RoughConductor, SingleBounce
from torchms.fresnel import Conductor, Ideal, Schlick
from torchms.maths.frame import Vec3
from torchms.onnx.exporter import checked
from torchms.onnx.parity.grid import grid
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import declarations, parameters, weights, with_parameters
from torchms.paths.vertex import Vertex


class Gain(Parametric):
    """A number a row."""

    value: Tensor

    def __init__(self, value: float | Tensor) -> None:
        super().__init__()
        self.declare("value", value, low=0.0, high=9.0, remedy="Take less.")


class Amplified(SingleBounce):
    """One bounce, times a declared number and what a float64 network says, both inside of containers."""

    def __init__(self, gain: float | Tensor) -> None:
        super().__init__()
        self.network = nn.Sequential(nn.Linear(1, 2, dtype=torch.float64))
        self.parts = nn.ModuleDict({"gain": Gain(gain)})

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        gain = self.parts["gain"].value
        network = self.network(wi.z[..., None].double()).sum(-1).abs()
        return [value * (gain * network).to(value.dtype) for value in super().evaluate(vertex, wi, wo, u)]


WI, WO = torch.tensor([0.6, 0.0, 0.8]), torch.tensor([-0.48, 0.36, 0.8])


def test_names_and_order() -> None:
    surface = RoughConductor(GGX(0.5), Schlick([0.2, 0.4]), Amplified(2.0))
    assert list(parameters(surface)) == ["fresnel.f0", "distribution.alpha", "scattering.parts.gain.value"]
    assert [n for n, _, value in declarations(surface) if value is None] == ["distribution.alpha_y"]
    assert list(weights(surface)) == ["scattering.network.0.weight", "scattering.network.0.bias"]
    record, value = parameters(surface)["fresnel.f0"]
    assert record.channels and record.range == "[0, 1]" and value is surface.fresnel.f0


def test_dtype_is_that_of_the_declared_parameters() -> None:
    """Also where a network of another stands in the scattering slot."""
    surface = RoughConductor(GGX(torch.tensor(0.5)), Ideal(), Amplified(2.0))
    assert surface.dtype == torch.float32
    surface.register_parameter("first", nn.Parameter(torch.zeros((), dtype=torch.float64)))
    assert surface.dtype == torch.float32 and surface(WI, WO).dtype == torch.float32


@pytest.mark.parametrize("block", [None, 3])
def test_a_map_inside_of_a_scattering_goes_along_with_the_rows(block: int | None) -> None:
    """Whatever modules stand between; every row as if it were alone."""
    gain = torch.linspace(0.5, 3, 10)
    scattering = Amplified(gain)
    surface = RoughConductor(GGX(0.5), Ideal(), scattering)
    value = surface(WI, WO, block=block)
    assert value.shape == (10, 1)
    for i in range(10):
        alone = with_parameters(surface, {"scattering.parts.gain.value": gain[i]})
        torch.testing.assert_close(value[i], alone(WI, WO))


def test_weights_are_replaced_and_keep_their_graph() -> None:
    surface = RoughConductor(GGX(0.5), Ideal(), Amplified(2.0))
    before = surface(WI, WO)
    doubled = {name: (2 * w.detach()).requires_grad_() for name, w in weights(surface).items()}
    other = with_parameters(surface, doubled)
    value = other(WI, WO)
    torch.testing.assert_close(value, 2 * before)
    assert torch.equal(surface(WI, WO), before) and other.distribution is surface.distribution
    assert all(bool((g != 0).any()) for g in torch.autograd.grad(value.sum(), list(doubled.values())))


def test_computed_tensors_are_what_they_compute() -> None:
    """Weights and parameters under `parametrize` go by their own names, not by those of what they come from."""

    class Twice(nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            return 2 * x

    scattering = Amplified(2.0)
    surface = RoughConductor(GGX(nn.Parameter(torch.tensor(0.2))), Ideal(), scattering)
    parametrize.register_parametrization(scattering.network[0], "weight", Twice())
    parametrize.register_parametrization(surface.distribution, "alpha", Twice())
    held = {name: value for name, (_, value) in parameters(surface).items()} | weights(surface)
    assert set(held) == {"distribution.alpha", "scattering.parts.gain.value"} | {
        f"scattering.network.0.{name}" for name in ("weight", "bias")
    }
    assert float(held["distribution.alpha"].detach()) == pytest.approx(0.4)
    clone = with_parameters(surface, held)
    assert torch.equal(clone(WI, WO), surface(WI, WO)) and type(clone.distribution) is GGX
    part = with_parameters(surface, {"scattering.network.0.bias": torch.zeros(2, dtype=torch.float64)})
    assert isinstance(part.scattering, Amplified)
    assert torch.equal(part.scattering.network[0].weight, held["scattering.network.0.weight"])


def test_tables_are_weights() -> None:
    found = weights(RoughConductor(GGX(0.5), Ideal(), KullaConty()))
    assert found and all(name.startswith("scattering.tables.") for name in found)


@pytest.mark.parametrize("name", ["alpha", "distribution.beta", "lens.alpha", "distribution.alpha.x"])
def test_a_name_of_nothing(name: str) -> None:
    with pytest.raises(KeyError):
        with_parameters(RoughConductor(GGX(0.5), Ideal()), {name: torch.tensor(0.5)})


def test_the_grid_of_the_onnx_check_covers_the_declared_ranges() -> None:
    graph = checked(RoughConductor(GTR(0.5, 1.5), Schlick(0.5), SingleBounce()), "forward", ("gamma", "f0"), "input", 1)
    inputs = grid(graph, 2000)
    assert 0 < float(inputs["gamma"].min()) < 0.1 and 9.9 < float(inputs["gamma"].max()) <= 10
    assert 0 <= float(inputs["f0"].min()) < 0.01 and 0.99 < float(inputs["f0"].max()) <= 1
    graph = checked(RoughConductor(GGX(0.5), Conductor(0.2, 3.0), SingleBounce()), "forward", ("eta", "k"), "input", 1)
    inputs = grid(graph, 2000)
    assert float(inputs["eta"].min()) > 0 and float(inputs["k"].max()) < 10
