"""Constrained parameters: in their range whatever the optimizer does, and α is still called α."""

import copy
from collections.abc import Callable

import pytest
import torch
from torch import nn
from torch.nn.utils import parametrize

import torchms
from torchms import GGX, HeightWalk, RoughConductor, RoughDielectric, RoughDiffuse, SingleBounce, constrain
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.parameters.declared import Parametric
from torchms.parameters.exchange import parameters

SURFACES: dict[str, tuple[Callable[[], torchms.BSDF], tuple[str, ...]]] = {
    "schlick": (
        lambda: RoughConductor(GGX(0.3, 0.6), Schlick([0.2, 0.5, 0.9]), SingleBounce()),
        ("distribution.alpha", "distribution.alpha_y", "fresnel.f0"),
    ),
    "conductor": (
        lambda: RoughConductor(GGX(0.3), Conductor([0.2, 1.5], [3.0, 2.0]), SingleBounce()),
        ("distribution.alpha", "fresnel.eta", "fresnel.k"),
    ),
    "glass": (lambda: RoughDielectric(GGX(0.3), Dielectric(1.5)), ("distribution.alpha", "fresnel.eta")),
    "chalk": (lambda: RoughDiffuse(GGX(0.3), [0.1, 0.9]), ("distribution.alpha", "reflectance")),
}


def value_of(surface: nn.Module, name: str) -> torch.Tensor:
    path, _, leaf = name.rpartition(".")
    value = getattr(surface.get_submodule(path), leaf)
    assert isinstance(value, torch.Tensor)
    return value


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("step", [-1e3, -3.0, 3.0, 1e3])
def test_stays_in_range_whatever_the_step(kind: str, step: float) -> None:
    """A step of SGD of any size, in either direction: the constructor would still take every value."""
    build, names = SURFACES[kind]
    before = build()
    surface = constrain(build(), *names)
    for name in names:
        torch.testing.assert_close(value_of(surface, name), value_of(before, name))
    assert {n for n, _ in surface.named_parameters()} == {
        ".".join([*n.split(".")[:-1], "parametrizations", n.split(".")[-1], "original"]) for n in names
    }
    optimizer = torch.optim.SGD(surface.parameters(), lr=1.0)
    for parameter in surface.parameters():
        parameter.grad = torch.full_like(parameter, step)
    optimizer.step()
    for name in names:
        value, start = value_of(surface, name), value_of(before, name)
        assert ((value - start) * step < 0).all()
        path, _, leaf = name.rpartition(".")
        owner = surface.get_submodule(path)
        assert isinstance(owner, Parametric)
        record = owner.declared[leaf]
        assert (value >= record.low).all() and (value <= record.high).all()


def test_gradient_reaches_the_parameters_through_blocks_and_maps(generator: torch.Generator) -> None:
    """A per-pixel map over several blocks of rows; the value is that of the same surface without constraints."""
    alpha = 0.1 + 0.8 * torch.rand(9000, generator=generator)
    free = RoughConductor(GGX(alpha), Schlick(0.5), HeightWalk(2))
    surface = constrain(RoughConductor(GGX(alpha), Schlick(0.5), HeightWalk(2)), "distribution.alpha", "fresnel.f0")
    wi = torch.tensor([0.6, 0.0, 0.8])
    u = surface.uniforms((9000,), generator=generator)
    value = surface(wi, wi, u)
    torch.testing.assert_close(value.detach(), free(wi, wi, u), rtol=1e-4, atol=1e-6)
    value.sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() and (p.grad != 0).any() for p in surface.parameters())
    assert {tuple(p.shape) for p in surface.parameters()} == {(9000,), (1,)}


def test_state_dict_round_trip() -> None:
    build, names = SURFACES["schlick"]
    surface = constrain(build(), *names)
    with torch.no_grad():
        for parameter in surface.parameters():
            parameter += 0.3
    other = constrain(build(), *names)
    other.load_state_dict(surface.state_dict())
    for name in names:
        torch.testing.assert_close(value_of(other, name), value_of(surface, name), rtol=0, atol=0)
    twin = copy.deepcopy(surface)
    torch.testing.assert_close(value_of(twin, "fresnel.f0"), value_of(surface, "fresnel.f0"), rtol=0, atol=0)


def test_assignment_and_removal() -> None:
    """Both are torch's own: α is set as α, and what is left after removal is a plain parameter."""
    distribution = constrain(GGX(0.3), "alpha")
    distribution.alpha = torch.tensor(0.7)
    torch.testing.assert_close(distribution.alpha.detach(), torch.tensor(0.7))
    parametrize.remove_parametrizations(distribution, "alpha")
    assert isinstance(distribution.alpha, nn.Parameter)
    torch.testing.assert_close(distribution.alpha.detach(), torch.tensor(0.7))


def test_narrower_range() -> None:
    glass = constrain(RoughDielectric(GGX(0.3), Dielectric(1.5)), "fresnel.eta", low=1.2, high=2.0)
    with torch.no_grad():
        next(glass.parameters()).fill_(-1e9)
    torch.testing.assert_close(value_of(glass, "fresnel.eta"), torch.tensor(1.2))


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize(
    "module,name,options,said",
    [
        (GGX(0.3), "beta", {}, "no such parameter; there are alpha"),
        (GGX(0.3), "alpha_y", {}, "no value"),
        (GGX(0.3), "alpha", {"low": 0.0}, r"within \[0.001, 2\]"),
        (GGX(0.3), "alpha", {"low": 0.5, "high": 0.5}, "range within"),
        (GGX(0.3), "alpha", {"low": 0.4}, "got 0.3"),
        (Schlick([0.2, 1.0]), "f0", {}, r"got 1 at index \(1,\)"),
        (constrain(GGX(0.3), "alpha"), "alpha", {}, "constrained already"),
        (GGX(torch.tensor(0.3, requires_grad=True) * 1), "alpha", {}, "computed from other tensors"),
    ],
)
def test_says_what_is_wrong(module: nn.Module, name: str, options: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        constrain(module, name, **options)


def test_names() -> None:
    assert list(parameters(RoughConductor(GGX(0.3), Schlick(0.5)))) == ["fresnel.f0", "distribution.alpha"]
