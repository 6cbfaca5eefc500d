"""D, G1 and the density of visible normals against Mitsuba 3's `MicrofacetDistribution`, in float32."""

from importlib import import_module
from types import ModuleType

import pytest
import torch
from cases import ELLIPTIC, direction
from torch import Tensor

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

ALPHAS = [(1.0, 1.0), (0.25, 0.25), (0.5, 0.8), (1.0, 0.1)]
VIEWS = [0.0, 0.5, 1.0, 1.4, 1.55]


@pytest.fixture(scope="module")
def mi() -> ModuleType:
    """A variant as a module of its own: the process's current variant is left alone."""
    return import_module("mitsuba.scalar_rgb")


def normals(alpha: tuple[float, float]) -> Tensor:
    """Normals whose slopes are up to 2.5 α long: D is within 1e-4 of its peak, where float32 exponents keep digits."""
    slopes = torch.cartesian_prod(torch.linspace(-2.5, 2.5, 11), torch.linspace(-2.5, 2.5, 11)) * torch.tensor(alpha)
    m = torch.cat([-slopes, torch.ones(len(slopes), 1)], 1)
    return m / m.norm(dim=1, keepdim=True)


def theirs(mi: ModuleType, name: str, alpha: tuple[float, float], sample_visible: bool = True):
    # The variants share this enum.
    types = import_module("mitsuba").MicrofacetType
    kind = {"ggx": types.GGX, "beckmann": types.Beckmann}[name]
    return mi.MicrofacetDistribution(kind, *alpha, sample_visible)


def vector(mi: ModuleType, v: Tensor):
    return mi.Vector3f(*v.tolist())


@pytest.mark.parametrize("name", ELLIPTIC)
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_density_of_normals(mi, name, alpha):
    m = normals(alpha)
    other = theirs(mi, name, alpha)
    expected = torch.tensor([float(other.eval(vector(mi, row))) for row in m])
    torch.testing.assert_close(ELLIPTIC[name](*alpha).D(m), expected, rtol=1e-5, atol=0)


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", VIEWS)
def test_ggx_masking_and_visible_density(mi, alpha, theta):
    w, m = direction(theta, dtype=torch.float32), normals(alpha)
    ours, other = ELLIPTIC["ggx"](*alpha), theirs(mi, "ggx", alpha)
    # Their G1 is zero where the macro-normal and m see w from different sides.
    facing = m[(m @ w) > 0.02]
    masking = float(other.smith_g1(vector(mi, w), vector(mi, facing[0])))
    assert float(1 / (1 + ours.Lambda(w))) == pytest.approx(masking, rel=1e-5)
    expected = torch.tensor([float(other.pdf(vector(mi, w), vector(mi, row))) for row in facing])
    torch.testing.assert_close(ours.D_visible(w, facing), expected, rtol=1e-5, atol=0)


@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", VIEWS)
def test_beckmann_visible_density_up_to_their_rational_masking(mi, alpha, theta):
    w, m = direction(theta, dtype=torch.float32), normals(alpha)
    ours, other = ELLIPTIC["beckmann"](*alpha), theirs(mi, "beckmann", alpha)
    facing = m[(m @ w) > 0.02]
    masking = float(other.smith_g1(vector(mi, w), vector(mi, facing[0])))
    # Their G1 is a rational fit, 3e-3 off, and 1 from cot θ / α = 1.6.
    assert float(1 / (1 + ours.Lambda(w))) == pytest.approx(masking, rel=4e-3)
    expected = torch.tensor([float(other.pdf(vector(mi, w), vector(mi, row))) for row in facing])
    # What is left is the density, but for its norm.
    exact = expected / (masking * (1 + ours.Lambda(w)))
    torch.testing.assert_close(ours.D_visible(w, facing), exact, rtol=1e-5, atol=0)
