"""Small scenes for the tests of the testbed."""

from collections.abc import Callable

import pytest
import torch

from torchms import GGX, Bidirectional, Invariance, RoughConductor, RoughDielectric, SingleBounce
from torchms.fresnel import Dielectric, Ideal
from torchms.render.lights import Environment
from torchms.render.paths import Sampling, Scene
from torchms.render.scenes import load_shape


@pytest.fixture
def mirror() -> Callable[..., RoughConductor]:
    """A rough mirror, F = 1."""
    return lambda alpha=0.7, scattering=None: RoughConductor(
        GGX(alpha), Ideal(), Bidirectional(Invariance(), 8) if scattering is None else scattering
    )


@pytest.fixture
def glass() -> RoughDielectric:
    """Rough glass with one bounce an interface: no microgeometry can hide an error of the paths."""
    return RoughDielectric(GGX(0.3), Dielectric(1.5), SingleBounce())


@pytest.fixture
def sky(generator: torch.Generator) -> Environment:
    """A map with a small bright sun: where one sampling alone is noisy."""
    texels = 0.2 + 0.5 * torch.rand(16, 32, 3, generator=generator)
    texels[4, 18] = torch.tensor([90.0, 70.0, 50.0])
    return Environment(texels)


@pytest.fixture
def scene() -> Callable[..., Scene]:
    """A scene with the shape of this name."""

    def build(shape: str, light, bsdf, sampling: Sampling = "mis", inner: int = 8, background: bool = False) -> Scene:
        return Scene(load_shape(shape)[0], light, bsdf, sampling, inner, background)

    return build
