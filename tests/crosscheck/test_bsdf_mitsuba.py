"""Single bounces against Mitsuba 3's `roughconductor` and `roughdielectric`.

Mitsuba's shadowing is separable, G1(wi) G1(wo); its own is divided out and ours put in. Its Beckmann G1 is a rational fit,
off by 3e-3, so it must be its own that is divided out. It computes in float32.
"""

from importlib import import_module
from types import ModuleType
from typing import Any

import pytest
import torch
from cases import ELLIPTIC, directions, each
from torch import Tensor

from torchms import MicrofacetDistribution, RoughConductor, RoughDielectric, SingleBounce
from torchms.fresnel import Conductor, Dielectric
from torchms.paths.masking import G2_dist

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

ALPHAS = {"isotropic": (0.5, 0.5), "rough": (0.9, 0.6), "anisotropic": (0.6, 0.2)}
N = 60
RTOL = 1e-5


@pytest.fixture(scope="module")
def mi() -> ModuleType:
    """Mitsuba, with a variant set: plugins are not to be had from a variant's own module."""
    mitsuba = import_module("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def facets(mi: ModuleType, distribution: str, alpha: tuple[float, float]) -> tuple[MicrofacetDistribution, Any]:
    """Ours, in float64, and theirs."""
    kind = {"ggx": mi.MicrofacetType.GGX, "beckmann": mi.MicrofacetType.Beckmann}[distribution]
    theirs = mi.MicrofacetDistribution(kind, *alpha, True)
    return ELLIPTIC[distribution](*(torch.tensor(a, dtype=torch.float64) for a in alpha)), theirs


def vector(mi: ModuleType, w: Tensor) -> Any:
    return mi.Vector3f(*w.tolist())


def value(mi: ModuleType, plugin: dict[str, Any], wi: Tensor, wo: Tensor) -> Tensor:
    """f · |cos θ_o|, (n, 3)."""
    bsdf, interaction, context = mi.load_dict(plugin), mi.SurfaceInteraction3f(), mi.BSDFContext()
    rows = []
    for a, b in zip(wi, wo, strict=True):
        interaction.wi = vector(mi, a)
        rows.append([float(x) for x in bsdf.eval(context, interaction, vector(mi, b))])
    return torch.tensor(rows, dtype=torch.float64)


def half(wi: Tensor, wo: Tensor, eta: float = 1.0) -> Tensor:
    h = torch.nn.functional.normalize(wi + eta * wo, dim=-1)
    return h * h[:, 2:].sign()


def separable(mi: ModuleType, theirs: Any, wi: Tensor, wo: Tensor, h: Tensor) -> Tensor:
    """Their G1(wi, h) G1(wo, h)."""
    rows = zip(wi, wo, h, strict=True)
    return torch.tensor([theirs.G(*(vector(mi, w) for w in row)) for row in rows], dtype=torch.float64)[:, None]


@each("distribution", ELLIPTIC)
@each("alpha", ALPHAS)
def test_conductor(mi, distribution, alpha, generator):
    ax, ay = ALPHAS[alpha]
    ours, theirs = facets(mi, distribution, (ax, ay))
    wi, wo = directions(N, generator, 0.15), directions(N, generator, 0.15)
    index = {"eta": 0.4, "k": 3.0}
    plugin = {"type": "roughconductor", "distribution": distribution, "alpha_u": ax, "alpha_v": ay}
    plugin |= {name: {"type": "rgb", "value": [x] * 3} for name, x in index.items()}
    undone = value(mi, plugin, wi, wo) / separable(mi, theirs, wi, wo, half(wi, wo)) * G2_dist(ours, wi, wo)[:, None]
    surface = RoughConductor(ours, Conductor(**index).double(), SingleBounce())
    # Far out in a Beckmann tail the exponent amplifies their float32; there the values themselves are lost.
    torch.testing.assert_close(surface(wi, wo).expand(-1, 3), undone, rtol=RTOL, atol=1e-6)


@each("distribution", ELLIPTIC)
@each("alpha", ALPHAS)
@pytest.mark.parametrize("side", [1, -1], ids=["outside", "inside"])
@pytest.mark.parametrize("transmitted", [False, True], ids=["reflected", "transmitted"])
def test_dielectric(mi, distribution, alpha, side, transmitted, generator):
    """Where light is likely to go, from and to directions that are not too flat; in radiance, so over η² as well."""
    ax, ay = ALPHAS[alpha]
    ours, theirs = facets(mi, distribution, (ax, ay))
    surface = RoughDielectric(ours, Dielectric(1.5).double(), SingleBounce())
    wi = directions(10 * N, generator, 0.15) * side
    wo = surface.sample(wi, surface.uniforms((10 * N,), generator=generator)).wo[:, 0]
    kept = ((wo[:, 2] * side > 0) != transmitted) & (wo[:, 2].abs() > 0.15)
    wi, wo = wi[kept], wo[kept]
    plugin = {"type": "roughdielectric", "distribution": distribution, "alpha_u": ax, "alpha_v": ay}
    plugin |= {"int_ior": 1.5, "ext_ior": 1.0}
    eta = 1.5**side if transmitted else 1.0
    local_i, local_o = wi * side, wo * side
    G = G2_dist(ours, local_i, local_o, transmitted)[:, None]
    G1 = separable(mi, theirs, wi, wo, half(wi, wo, eta))
    theirs_value = value(mi, plugin, wi, wo)[:, :1]
    undone = torch.where(G1 > 0, theirs_value / torch.where(G1 > 0, G1, 1.0) * G, 0.0)
    assert (undone > 1e-4).sum() > N / 2
    torch.testing.assert_close(surface(wi, wo), undone, rtol=RTOL, atol=1e-6)
