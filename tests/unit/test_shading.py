"""World space: frames, light and view, and what others call roughness."""

import math

import pytest
import torch
from cases import TOLERANCES, bsdf, direction, directions, each
from torch import Tensor

import torchms
from torchms import GGX, RoughConductor, SingleBounce, Stream
from torchms.fresnel import Schlick
from torchms.shading import CONVENTIONS, ShadingFrame, alpha, alphas, sample, shade
from torchms.shading.frame import columns
from torchms.shading.roughness import ANISOTROPIES

POLES = {"up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "y": (0.0, -1.0, 0.0)}
NEAR = [1e-12, 1e-7, 1e-4, 1e-2]


def normals(generator: torch.Generator, dtype: torch.dtype) -> Tensor:
    """Over the sphere, at the poles and next to them, of any length."""
    poles = torch.tensor(list(POLES.values()), dtype=torch.float64)
    near = [p + e * torch.randn(4, 3, generator=generator, dtype=torch.float64) for p in poles for e in NEAR]
    w = torch.nn.functional.normalize(torch.cat([directions(200, generator), poles, *near]), dim=-1)
    return (w * (0.1 + 10 * torch.rand(len(w), 1, generator=generator, dtype=torch.float64))).to(dtype)


def axes(frame: ShadingFrame) -> Tensor:
    """(..., 3, 3): tangent, bitangent and normal as rows."""
    return torch.stack([columns(v) for v in (frame.tangent, frame.bitangent, frame.normal)], -2)


@pytest.mark.parametrize("given", [False, True], ids=["continuous", "tangent"])
@pytest.mark.parametrize("dtype", TOLERANCES, ids=str)
def test_frames_are_orthonormal(given, dtype, generator):
    """And right-handed, whatever tangent is given: along the normal and zero ones too; and back is back."""
    n = normals(generator, dtype)
    tangent = None
    if given:
        tangent = torch.randn(len(n), 3, generator=generator, dtype=dtype)
        tangent[::7], tangent[1::7] = n[::7], 0.0
    frame = ShadingFrame(n, tangent)
    eps = 16 * torch.finfo(dtype).eps
    matrix = axes(frame)
    torch.testing.assert_close(matrix @ matrix.mT, torch.eye(3, dtype=dtype).expand(len(n), 3, 3), rtol=0, atol=eps)
    torch.testing.assert_close(torch.linalg.det(matrix), torch.ones(len(n), dtype=dtype), rtol=0, atol=eps)
    w = directions(len(n), generator, dtype=dtype)
    torch.testing.assert_close(frame.to_world(frame.to_local(w)), w, rtol=0, atol=eps)
    torch.testing.assert_close(frame.to_local(n)[:, 2], n.norm(dim=-1), rtol=eps, atol=0)
    if tangent is not None:
        local = frame.to_local(tangent)[2::7]
        assert bool((local[:, 0] > 0).all()) and float(local[:, 1].abs().max()) < 10 * eps


def test_the_tangent_is_continuous():
    """Steps of the normal along circles, over the equator and both axes, turn it by as much; straight down excepted."""
    t = torch.linspace(0, 2 * math.pi, 4001, dtype=torch.float64)
    for lift in (-0.9, -0.3, 0.0, 0.4):
        r = math.sqrt(1 - lift * lift)
        for n in (
            torch.stack([r * t.cos(), r * t.sin(), lift + 0 * t], -1),
            torch.stack([r * t.sin(), lift + 0 * t, r * t.cos()], -1),
        ):
            if n[:, 2].min() < -0.97:
                continue
            step = columns(ShadingFrame(n).tangent).diff(dim=0).norm(dim=-1)
            assert float(step.max()) < 12 * 2 * math.pi / 4000


@each("pole", POLES)
def test_gradients_are_finite_at_the_poles(pole, generator):
    for tangent in (None, torch.tensor([0.3, -0.2, 0.7], dtype=torch.float64), torch.tensor(POLES[pole]).double()):
        n = torch.tensor(POLES[pole], dtype=torch.float64, requires_grad=True)
        w = direction(0.6).requires_grad_()
        frame = ShadingFrame(n, tangent)
        total = (frame.to_local(w) * torch.tensor([1.0, 2.0, 3.0])).sum() + frame.to_world(w).sum()
        assert all(bool(g.isfinite().all()) for g in torch.autograd.grad(total, (n, w)))


def rotation(generator: torch.Generator, n: int) -> Tensor:
    """(n, 3, 3), columns x, y and z of local frames in the world."""
    q, _ = torch.linalg.qr(torch.randn(n, 3, 3, generator=generator, dtype=torch.float64))
    return q * torch.linalg.det(q)[:, None, None]


@pytest.mark.parametrize(
    "material,scattering",
    [("conductor[conductor]", "single"), ("dielectric", "height-walk"), ("diffuse", "invariance")],
)
def test_shading_is_the_local_evaluation(material, scattering, generator):
    """Everything turned by a rotation, with an anisotropic roughness; with and without its cosine."""
    surface = bsdf(material, scattering, max_order=2)
    wi, wo = directions(20, generator), directions(20, generator)
    R = rotation(generator, 20)
    view, light = (torch.einsum("nij,nj->ni", R, w) for w in (wi, wo))
    u = Stream(4, 3)
    expected = surface(wi, wo, u)
    found = shade(surface, R[..., 2], view, light, u, tangent=R[..., 0])
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)
    bare = shade(surface, R[..., 2], view, light, u, tangent=R[..., 0], cosine=False)
    torch.testing.assert_close(bare * wo[:, 2:].abs(), expected, rtol=1e-9, atol=1e-12)
    scaled = shade(surface, 3 * R[..., 2], 2 * view, 0.1 * light, u, tangent=R[..., 0], normalize=True)
    torch.testing.assert_close(scaled, expected, rtol=1e-9, atol=1e-12)
    # Samples too: where they are, and how dense.
    drawn = sample(surface, R[..., 2], view, Stream(5, 3), tangent=R[..., 0])
    local = surface.sample(wi, Stream(5, 3))
    torch.testing.assert_close(torch.einsum("nji,knj->nki", R, drawn.light), local.wo, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(drawn.pdf.T, local.pdf, rtol=1e-7, atol=1e-9)


def test_lights_broadcast(generator):
    """L lights before the pixels, whose maps line up; behind them with axes of one; and samples as they come."""
    rough, f0 = torch.rand(4, 5, generator=generator).double(), torch.rand(4, 5, 3, generator=generator).double()
    surface = RoughConductor(GGX(alpha(rough, least=0.1)), Schlick(f0), SingleBounce())
    normal, view = (directions(20, generator, 0.5).reshape(4, 5, 3) for _ in range(2))
    lights = directions(3, generator, 0.5)
    first = shade(surface, normal, view, lights[:, None, None])
    assert first.shape == (3, 4, 5, 3)
    for k, light in enumerate(lights):
        torch.testing.assert_close(first[k], shade(surface, normal, view, light.expand(4, 5, 3)))
    behind = RoughConductor(GGX(alpha(rough[..., None], least=0.1)), Schlick(f0[..., None, :]), SingleBounce())
    last = shade(behind, normal[..., None, :], view[..., None, :], lights)
    torch.testing.assert_close(last, first.movedim(0, 2))
    drawn = sample(surface, normal, view, Stream(1, 7))
    value = shade(surface, normal, view, drawn.light)
    assert value.shape == (7, 4, 5, 3) and drawn.pdf.shape == (7, 4, 5)


def test_samples_estimate_the_albedo(generator, budget):
    """The mean of value over density of what `sample` gives, without a transposition, is the energy."""
    surface = RoughConductor(GGX(0.6, 0.3), Schlick([0.8]), SingleBounce()).double()
    normal, view, tangent = direction(1.0, 0.2), direction(0.7, 0.4), direction(0.4, 2.0)
    drawn = sample(surface, normal, view, surface.uniforms((), 1 << 15, generator=generator), tangent=tangent)
    ratio = (shade(surface, normal, view, drawn.light, tangent=tangent)[..., 0] / drawn.pdf).nan_to_num(0)
    walks = surface.albedo(
        ShadingFrame(normal, tangent).to_local(view), surface.uniforms((1 << 15,), generator=generator)
    ).reflected[..., 0, 0]
    z = (ratio.mean() - walks.mean()) / ((ratio.var() + walks.var()) / len(ratio)).sqrt()
    budget(2 * torch.distributions.Normal(0.0, 1.0).cdf(-z.abs()))


@pytest.mark.parametrize("two_sided", [False, True])
def test_from_below(two_sided, generator):
    """A normal turned away from the view: dark, or the same if the surface has two sides."""
    surface = bsdf("conductor[conductor]", "single")
    normal, view, light = direction(0.3), direction(0.9), direction(0.2, 2.0)
    tangent = direction(1.5, 0.1)
    front = shade(surface, normal, view, light, tangent=tangent)
    back = shade(surface, -normal, view, light, tangent=tangent, two_sided=two_sided)
    assert bool((front > 0).all())
    torch.testing.assert_close(back, front if two_sided else torch.zeros_like(front))


@pytest.mark.parametrize("dtype", TOLERANCES, ids=str)
def test_background_pixels(dtype, generator):
    """Zero normals, views and lights: zero values, densities and gradients, and neighbours as without them."""
    surface = bsdf("conductor[conductor]", "invariance", max_order=2, dtype=dtype)
    leaves = [directions(6, generator, 0.3, dtype).requires_grad_() for _ in range(3)]
    whole = shade(surface, *leaves, u=Stream(2))
    holes = [w.detach().clone() for w in leaves]
    for i, w in enumerate(holes):
        w[i] = 0.0
        w.requires_grad_()
    value = shade(surface, *holes, u=Stream(2))
    assert bool((value[:3] == 0).all()) and torch.equal(value[3:], whole[3:])
    assert bool((sample(surface, *holes[:2], u=Stream(2)).pdf[:, :2] == 0).all())
    for found, expected in zip(
        torch.autograd.grad(value.sum(), holes), torch.autograd.grad(whole[3:].sum(), leaves), strict=True
    ):
        assert bool((found[:3] == 0).all())
        torch.testing.assert_close(found[3:], expected[3:])


@pytest.mark.usefixtures("messages")
def test_what_is_refused():
    surface, w = bsdf("conductor[conductor]", "single"), direction(0.3)
    with pytest.raises(ValueError, match=r"light must hold unit vectors"):
        shade(surface, w, w, 2 * w)
    with pytest.raises(ValueError, match=r"view must hold unit vectors"):
        sample(surface, w, 2 * w, Stream(1))
    with pytest.raises(ValueError, match=r"normal must hold finite vectors; got nan at index \(1,\)"):
        ShadingFrame(torch.tensor([0.0, math.nan, 1.0]))
    with pytest.raises(ValueError, match=r"tangent must be \(\*batch, 3\)"):
        ShadingFrame(w, w[:2])
    with pytest.raises(ValueError, match=r"light must be \(\*batch, 3\)"):
        shade(surface, w, w, w[:2])
    with pytest.raises(ValueError, match=r"do not broadcast: normal \(3, 3\), view \(3, 3\), light \(2, 3\)"):
        shade(surface, w.expand(3, 3), w.expand(3, 3), w.expand(2, 3))


def test_conventions_are_their_formulas():
    """At roughnesses with round results, and all increasing and within the range of a distribution."""
    assert torch.allclose(alpha(0.5), torch.tensor(0.25)) and torch.allclose(alpha(0.25, "pbrt"), torch.tensor(0.5))
    assert torch.allclose(alpha(1.0, "pbrt-v3"), torch.tensor(1.62142)) and float(
        alpha(0.3, "mitsuba")
    ) == pytest.approx(0.3)
    x = math.log(0.4)
    expected = 1.62142 + 0.819955 * x + 0.1734 * x**2 + 0.0171201 * x**3 + 0.000640711 * x**4
    assert float(alpha(torch.tensor(0.4, dtype=torch.float64), "pbrt-v3")) == pytest.approx(expected, rel=1e-12)
    r = torch.linspace(0.02, 1, 60, dtype=torch.float64)
    for name in CONVENTIONS:
        value = alpha(r, name, least=1e-3).detach()
        assert bool((value.diff() > 0).all()) and float(value.min()) >= 1e-3 and float(value.max()) <= 2
        GGX(value)
    assert torchms.alpha is alpha and float(alpha(0.0, least=1e-3)) == pytest.approx(1e-3)


def test_anisotropies_are_their_formulas():
    r, a = torch.rand(2, 20, dtype=torch.float64, generator=torch.Generator().manual_seed(1)).unbind(0)
    for name in ANISOTROPIES:
        x, y = alphas(r, a, name)
        assert bool((x >= y).all())
        assert all(torch.allclose(v, alpha(r, name)) for v in alphas(r, torch.zeros_like(a), name))
    x, y = alphas(r, a, "disney")
    torch.testing.assert_close(x * y, r**4)
    torch.testing.assert_close(y / x, 1 - 0.9 * a)
    x, y = alphas(r, a, "gltf")
    torch.testing.assert_close((x - y) / (1 - y), a * a)
    assert float(alphas(0.3, 1.0, "gltf")[0]) == 1.0


@pytest.mark.usefixtures("messages")
def test_roughness_that_is_none():
    with pytest.raises(ValueError, match=r"convention=...\) must be one of alpha, gltf.*got 'blender'"):
        alpha(0.5, "blender")
    with pytest.raises(ValueError, match=r"alpha\(roughness=...\) must lie in \[0, 1\]; got 1.5 at index \(1,\)"):
        alpha(torch.tensor([0.5, 1.5]))
    with pytest.raises(ValueError, match=r"alphas\(anisotropy=...\) must lie in \[0, 1\]; got nan"):
        alphas(0.5, math.nan)
    with pytest.raises(ValueError, match=r"least must lie in"):
        alpha(0.5, least=-1.0)
