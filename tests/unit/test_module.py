"""Parameters: how they are checked, stored, sliced and trained."""

import copy

import pytest
import torch
from torch import nn

from torchms import GGX, Beckmann, RoughConductor, RoughDielectric, RoughDiffuse
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.parameters.declared import describe, first_bad
from torchms.parameters.exchange import with_parameters


def surfaces():
    return {
        "conductor": lambda alpha: RoughConductor(GGX(alpha), Conductor([0.2, 0.9], [3.9, 2.5])),
        "dielectric": lambda alpha: RoughDielectric(Beckmann(alpha, 0.3), Dielectric(1.5)),
        "diffuse": lambda alpha: RoughDiffuse(GGX(alpha), [0.2, 0.6, 1.0]),
    }


each_surface = pytest.mark.parametrize("make", surfaces().values(), ids=list(surfaces()))


@each_surface
def test_state_dict_round_trip(make):
    """Every number is in it, and nothing else is; the values of another surface are taken over."""
    one, other = make(0.5), make(0.2)
    state = copy.deepcopy(one.state_dict())
    assert "distribution.alpha" in state
    other.load_state_dict(state, strict=True)
    wi = torch.tensor([0.6, 0.0, 0.8])
    u = one.uniforms((), 4, generator=torch.Generator().manual_seed(1))
    assert torch.equal(one(wi, wi, u), other(wi, wi, u))


@each_surface
def test_dtype_follows_to(make):
    surface = make(0.5).to(torch.float64)
    assert surface.dtype == torch.float64
    assert all(value.dtype == torch.float64 for value in surface.state_dict().values())


def test_a_number_becomes_a_buffer_and_a_parameter_stays_one():
    fixed, trained = GGX(0.5), GGX(nn.Parameter(torch.tensor(0.5)), 0.3)
    assert [name for name, _ in fixed.named_buffers()] == ["alpha"] and not list(fixed.parameters())
    assert [name for name, _ in trained.named_parameters()] == ["alpha"]
    assert [name for name, _ in trained.named_buffers()] == ["alpha_y"]


def test_a_parameter_is_trained():
    """A step of gradient descent reaches the number inside."""
    alpha = nn.Parameter(torch.tensor(0.5))
    surface = RoughConductor(GGX(alpha), Schlick(nn.Parameter(torch.tensor([0.04]))))
    optimizer = torch.optim.SGD(surface.parameters(), lr=1e-2)
    wi = torch.tensor([0.0, 0.6, 0.8])
    surface(wi, wi, surface.uniforms((), 4, generator=torch.Generator().manual_seed(1))).sum().backward()
    before = alpha.detach().clone()
    optimizer.step()
    assert alpha.detach() != before and surface.distribution.alpha is alpha


def test_a_tensor_keeps_its_graph():
    """α from a network: the gradient arrives at what it was computed from."""
    x = torch.zeros(4, requires_grad=True)
    surface = RoughDiffuse(GGX(torch.sigmoid(x)), 0.8)
    wi = torch.tensor([0.0, 0.6, 0.8])
    surface(wi, wi, surface.uniforms((4,), 2, generator=torch.Generator().manual_seed(1))).sum().backward()
    assert (x.grad != 0).all()


def test_bound_copies_without_touching():
    """The copy has the new numbers, children included; the original keeps its own."""
    surface = RoughConductor(GGX(torch.full((3,), 0.5)), Schlick([0.1, 0.2]))
    copied = with_parameters(surface, {"distribution.alpha": surface.distribution.get_buffer("alpha")[:2]})
    assert copied.distribution.alpha.shape == (2,) and surface.distribution.alpha.shape == (3,)
    assert copied.fresnel.f0 is surface.fresnel.f0
    assert sorted(copied.parameter_batch_shapes()) == [torch.Size([]), torch.Size([2])]


def test_bound_sees_through_parametrizations():
    class Positive(nn.Module):
        def forward(self, x):
            return torch.nn.functional.softplus(x) * 0.5

    facets = GGX(nn.Parameter(torch.tensor(0.7)))
    nn.utils.parametrize.register_parametrization(facets, "alpha", Positive())
    surface = RoughConductor(facets, Schlick(0.5))
    wi = torch.tensor([0.0, 0.6, 0.8])
    surface(wi, wi, surface.uniforms((), 1, generator=torch.Generator().manual_seed(1))).sum().backward()
    assert facets.get_parameter("parametrizations.alpha.original").grad is not None


def test_the_first_bad_element_is_named():
    assert first_bad(torch.tensor(True), torch.tensor(-1.0)) == "-1"
    assert (
        first_bad(torch.tensor([[False, False], [False, True]]), torch.tensor([[1.0, 1], [1, 7]]))
        == "7 at index (1, 1)"
    )


def test_repr_shows_the_numbers():
    assert describe(GGX(torch.rand(9, 9) + 0.1)) == "alpha=<(9, 9)>"
    assert describe(GGX(0.3, 0.1)) == "alpha=0.3, alpha_y=0.1"
    assert describe(Conductor([0.2, 1 / 3], 3)) == "eta=[0.2, 0.333333], k=[3.0]"
    text = repr(RoughDielectric(GGX(0.5, 0.25), Dielectric(1.5)))
    assert "alpha=0.5, alpha_y=0.25" in text and "eta=1.5" in text and "max_order=8" in text and "radiance" in text
