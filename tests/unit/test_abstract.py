"""What is abstract cannot be built, and what is built is copied and parametrized like any module."""

import copy

import pytest
import torch
from torch import nn
from torch.nn.utils import parametrize

from torchms import BSDF, GGX, Invariance, MicrofacetDistribution, RoughConductor, Scattering, Segment, Unidirectional
from torchms.approximations.compensated import Compensated
from torchms.cli.expression import constructors, parse_bsdf
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel import Fresnel, Ideal, Schlick
from torchms.paths.vertex import Vertex
from torchms.sampling.proposals import Proposal

BASES = [
    BSDF,
    MicrofacetDistribution,
    EllipticDistribution,
    Scattering,
    Compensated,
    Segment,
    Fresnel,
    Vertex,
    Proposal,
]


@pytest.mark.parametrize("base", BASES, ids=lambda base: base.__name__)
def test_a_base_is_not_built(base: type) -> None:
    with pytest.raises(TypeError, match="abstract"):
        base(*((0.5,) if base is EllipticDistribution else ()))


@pytest.mark.parametrize("text", ["BSDF()", "RoughConductor(MicrofacetDistribution(), Ideal())", "Segment()"])
def test_nor_is_it_on_the_command_line(text: str) -> None:
    assert not {base.__name__ for base in BASES} & set(constructors())
    with pytest.raises(ValueError, match="is not a constructor"):
        parse_bsdf(text)


def test_half_a_distribution_is_not_built() -> None:
    class Half(MicrofacetDistribution):
        def normal_density(self, m):
            return m.z

    with pytest.raises(TypeError, match="projected_area"):
        Half()  # pyright: ignore[reportAbstractUsage]  # refused


def test_modules_stay_modules() -> None:
    """`torch.nn.utils.parametrize` makes classes of its own, `deepcopy` copies those."""

    class Half(nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return x / 2

    surface = RoughConductor(GGX(nn.Parameter(torch.tensor(0.8))), Ideal(), Unidirectional(Invariance(), 2))
    parametrize.register_parametrization(surface.distribution, "alpha", Half())
    again = copy.deepcopy(surface)
    wi, u = torch.tensor([0.6, 0.0, 0.8]), surface.uniforms((), 2, generator=torch.Generator().manual_seed(1))
    expected = RoughConductor(GGX(0.4), Ideal(), Unidirectional(Invariance(), 2))(wi, wi, u)
    assert torch.equal(surface(wi, wi, u), expected) and torch.equal(again(wi, wi, u), expected)
    assert isinstance(again, BSDF) and isinstance(again.distribution, MicrofacetDistribution)
    parametrize.remove_parametrizations(again.distribution, "alpha")
    assert type(again.distribution) is GGX and isinstance(Schlick(0.5), Fresnel)
