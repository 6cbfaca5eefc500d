"""Functions of other projects under their own names: their formulas with one bounce, white with all, and what they refuse."""

import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from cases import directions, each
from torch import Tensor

import torchms
from torchms.dropins import GGX_specular, pbr_bsdf
from torchms.dropins.pypbr import CookTorranceBRDF

N, L = 6, 5
TOLERANCE = 1e-6


def dot(a: Tensor, b: Tensor) -> Tensor:
    return (torch.nn.functional.normalize(a, dim=-1) * torch.nn.functional.normalize(b, dim=-1)).sum(-1)


def halfway(a: Tensor, b: Tensor) -> Tensor:
    return torch.nn.functional.normalize(a, dim=-1) + torch.nn.functional.normalize(b, dim=-1)


class Points(SimpleNamespace):
    """Points that are lit: normal and view (N, 3), light (N, L, 3), roughness (N, 1), f0 (N, 3), float64."""

    @classmethod
    def drawn(cls, generator: torch.Generator) -> "Points":
        def rand(*shape: int) -> Tensor:
            return torch.rand(*shape, generator=generator, dtype=torch.float64)

        scale = 0.2 + 3 * rand(3, N, 1)
        normal, view = (directions(N, generator) * scale[k] for k in (0, 1))
        light = directions(N * L, generator).reshape(N, L, 3) * scale[2, :, None]
        return cls(normal=normal, view=view, light=light, roughness=0.2 + 0.8 * rand(N, 1), f0=rand(N, 3))

    def call(self, **words) -> Tensor:
        return GGX_specular(self.normal, self.view, self.light, self.roughness, self.f0, **words)


def test_ggx_specular_is_its_formula(generator):
    """D F G / (4 cos cos), written once more as it stands in print, with Schlick's G and Karis' exponent."""
    p = Points.drawn(generator)
    n = p.normal * torch.where(dot(p.normal, p.view) < 0, -1.0, 1.0)[:, None]
    h = halfway(p.light, p.view[:, None])
    nl, nv = (x.clamp(1e-6, 1) for x in (dot(n[:, None], p.light), dot(n, p.view)[:, None]))
    nh, vh = (x.clamp(1e-6, 1) for x in (dot(n[:, None], h), dot(p.view[:, None], h)))
    alpha2, k = p.roughness**4, (p.roughness + 1) ** 2 / 8
    D = alpha2 / (math.pi * (nh**2 * (alpha2 - 1) + 1) ** 2)
    G = nl / (nl * (1 - k) + k) * (nv / (nv * (1 - k) + k))
    F = p.f0[:, None] + (1 - p.f0[:, None]) * 2 ** ((-5.55473 * vh - 6.98316) * vh)[..., None]
    expected = F * (D * G / (4 * nl * nv))[..., None]
    found = p.call(bounces=1)
    assert found.shape == (N, L, 3)
    torch.testing.assert_close(found, expected, rtol=TOLERANCE, atol=TOLERANCE)


def test_pbr_bsdf_is_its_formula(generator):
    """Lambert's base beside correlated masking as [Heitz2014] has it, for positions, in batches (B, H, W, 3)."""
    shape = (2, 3, 4)
    kd, arm = (torch.rand(*shape, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    pos, nrm = (directions(24, generator).reshape(*shape, 3) for _ in range(2))
    eye, lamp = (3 * directions(2, generator, 0.5).reshape(2, 1, 1, 3) for _ in range(2))
    r, metal = arm[..., 1], arm[..., 2]
    alpha2 = r.clamp_min(0.3) ** 4
    v, d = eye - pos, lamp - pos
    nv, nl, nh, vh = dot(nrm, v), dot(nrm, d), dot(nrm, halfway(v, d)), dot(v, halfway(v, d))
    lit = (nv > 1e-4) & (nl > 1e-4)

    def Lambda(c: Tensor) -> Tensor:
        return (torch.sqrt(1 + alpha2 * (1 / c**2 - 1)) - 1) / 2

    f0 = (0.04 * (1 - metal)[..., None] + metal[..., None] * kd) * (1 - arm[..., :1])
    D = alpha2 / (math.pi * (nh**2 * (alpha2 - 1) + 1) ** 2)
    F = f0 + (1 - f0) * ((1 - vh) ** 5)[..., None]
    single = F * (D / (1 + Lambda(nv) + Lambda(nl)) / (4 * nv))[..., None]
    expected = kd * (1 - metal)[..., None] * nl.clamp_min(0)[..., None] / math.pi + torch.where(
        lit[..., None], single, 0
    )
    found = pbr_bsdf(kd, arm, pos, nrm, eye, lamp, 0.3, bounces=1)
    assert found.shape == (*shape, 3) and int(lit.sum()) > 3
    torch.testing.assert_close(found, expected, rtol=TOLERANCE, atol=TOLERANCE)


def material(generator: torch.Generator, **fixed: float) -> SimpleNamespace:
    """Maps (C, 4, 5) under the names of PyPBR."""
    maps = {"linear_albedo": 3, "roughness": 1, "metallic": 1}
    drawn = {
        name: 0.2 + 0.8 * torch.rand(c, 4, 5, generator=generator, dtype=torch.float64) for name, c in maps.items()
    }
    drawn |= {name: torch.full_like(drawn[name], value) for name, value in fixed.items()}
    return SimpleNamespace(**drawn, device=torch.device("cpu"), normal=None)


def test_cook_torrance_is_its_formula(generator):
    """α = r and k = (r + 1)² / 8, under a light above the maps; tests/crosscheck has PyPBR itself."""
    m = material(generator)
    eye, lamp, power = (
        torch.tensor(x, dtype=torch.float64) for x in ([0.1, 0.2, 2], [0.3, -0.2, 0.9], [0.5, 0.6, 0.7])
    )
    y, x = torch.meshgrid(*(torch.linspace(-0.6, 0.6, n).double() for n in (4, 5)), indexing="ij")
    d = lamp - torch.stack([x, -y, 0 * x], -1)
    n = torch.tensor([0.0, 0.0, 1.0]).double()
    base, r, metal = m.linear_albedo.movedim(0, -1), m.roughness[0], m.metallic[0]
    k = (r + 1) ** 2 / 8
    nv, nl, nh, vh = dot(n, eye), dot(n, d), dot(n, halfway(eye, d)), dot(eye, halfway(eye, d))
    f0 = 0.04 + (base - 0.04) * metal[..., None]
    F = f0 + (1 - f0) * ((1 - vh) ** 5)[..., None]
    D = r**2 / (math.pi * (nh**2 * (r**2 - 1) + 1) ** 2)
    V = 1 / (4 * (nv * (1 - k) + k) * (nl * (1 - k) + k))
    value = (1 - F) * (1 - metal)[..., None] * base / math.pi + F * (D * V)[..., None]
    expected = (value * (nl / (d * d).sum(-1))[..., None] * power).clamp(0, 1).movedim(-1, 0)
    found = CookTorranceBRDF("point", bounces=1)(m, eye, lamp, power, 1.2, return_srgb=False)
    assert found.shape == (3, 4, 5)
    # What PyPBR adds to its denominators is not in print.
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=TOLERANCE)


def hemisphere(n: int = 64) -> tuple[Tensor, Tensor]:
    """Directions (m, 3) with y ≥ 0, and their solid angles: Gauss' nodes in the cosine and the azimuth."""
    x, w = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(n))
    mu = ((x + 1) / 2)[:, None]
    phi = ((x + 1) / 2 * math.pi)[None]
    rho = (1 - mu * mu).sqrt()
    grid = torch.stack(torch.broadcast_tensors(rho * phi.cos(), rho * phi.sin(), mu), -1)
    return grid.reshape(-1, 3), (w[:, None] / 2 * w / 2 * math.pi).reshape(-1)


VIEWS = torch.tensor([[math.sqrt(1 - c * c), 0.0, c] for c in (1.0, 0.5, 0.15)], dtype=torch.float64)
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


@each("r", [0.5, 1.0])
def test_ggx_specular_is_white(r):
    """F0 = 1 returns all light from everywhere, where the formula loses up to 69 %; the half is mirrored."""
    light, angle = hemisphere()
    arguments = (UP.expand(3, 3), VIEWS, light.expand(3, -1, 3), r, 1.0)
    for bounces, low, high in (("all", 0.998, 1.002), (1, 0.3, 0.9)):
        total = 2 * (GGX_specular(*arguments, bounces=bounces)[..., 0] * light[:, 2] * angle).sum(-1)
        assert bool(((total > low) & (total < high)).all()), total


@each("metallic", [0.0, 0.5, 1.0])
def test_pbr_bsdf_is_white(metallic):
    """A white kd, whatever it is made of; with one bounce a dielectric returns too much, and a metal too little."""
    light, angle = hemisphere()
    white, arm = torch.ones(3, 1, 3).double(), torch.tensor([0.0, 0.7, metallic]).double()
    arguments = (white, arm, torch.zeros(3, 1, 3).double(), UP, 10 * VIEWS[:, None], 10 * light)
    for bounces, low, high in (("all", 0.998, 1.002), (1, 0.5, 0.96 if metallic else 1.1)):
        total = 2 * (pbr_bsdf(*arguments, bounces=bounces) * angle[:, None]).sum(-2)
        assert bool(((total > low) & (total < high)).all()), total


def test_cook_torrance_is_metallic_roughness(generator):
    """With all bounces, α = r: that of glTF is the root."""
    m = material(generator)
    eye, lamp = torch.tensor([0.1, 0.2, 1]).double(), torch.tensor([0.3, -0.2, 0.9]).double()
    found = CookTorranceBRDF("directional")(m, eye, lamp, torch.ones(3).double(), return_srgb=False)
    surface = torchms.MetallicRoughness(m.linear_albedo.movedim(0, -1), m.metallic[0], m.roughness[0].sqrt())
    expected = surface(*(x / x.norm() for x in (eye, lamp)))
    torch.testing.assert_close(found.movedim(0, -1), expected.clamp(0, 1))


@each("bounces", ["all", 1])
def test_gradients_reach_everything(bounces, generator):
    """And are those of differences; at points that are none they are zero."""
    p = Points.drawn(generator)
    p.view = p.normal + 0.5 * p.view
    p.light = p.normal[:, None] + 0.5 * p.light
    leaves = [x.clone().requires_grad_() for x in (p.normal, p.view, p.light, p.roughness, p.f0)]
    value = GGX_specular(*leaves, bounces=bounces)
    gradients = torch.autograd.grad(value.sum(), leaves)
    for k, (leaf, gradient) in enumerate(zip(leaves, gradients, strict=True)):
        step = 1e-6 * torch.randn(leaf.shape, generator=generator, dtype=torch.float64)
        ends = []
        for sign in (1, -1):
            moved = [x.detach() for x in leaves]
            moved[k] = moved[k] + sign * step
            ends.append(float(GGX_specular(*moved, bounces=bounces).sum()))
        assert (ends[0] - ends[1]) / 2 == pytest.approx(float((gradient * step).sum()), rel=2e-4)
    holes = [x.detach().clone() for x in leaves]
    for k in range(3):
        holes[k][k] = 0.0
    holes = [x.requires_grad_() for x in holes]
    value = GGX_specular(*holes, bounces=bounces)
    assert bool((value[:3] == 0).all())
    torch.testing.assert_close(value[3:], GGX_specular(*(x[3:] for x in holes), bounces=bounces))
    for gradient in torch.autograd.grad(value.sum(), holes):
        assert bool((gradient[:3] == 0).all()) and bool(gradient.isfinite().all())


def test_gradients_of_positions_and_maps(generator):
    """Of both modes of `pbr_bsdf`: they are there, finite, and not zero."""
    points = [torch.rand(3, 3, generator=generator, dtype=torch.float64) for _ in range(3)]
    places = [torch.tensor(x).double() for x in ([[0.1, 0.2, 1.0]] * 3, [[0.0, 0.0, 5.0]] * 3, [[1.0, 0.0, 4.0]] * 3)]
    for bounces in ("all", 1):
        leaves = [x.clone().requires_grad_() for x in (points[0], points[1], points[2], *places)]
        gradients = torch.autograd.grad(pbr_bsdf(*leaves, min_roughness=0.1, bounces=bounces).sum(), leaves)
        assert all(bool(g.isfinite().all()) and bool((g != 0).any()) for g in gradients)


def test_shapes(generator):
    """Further axes, numbers in place of maps, one channel; a normal turned away is that turned to the view."""
    p = Points.drawn(generator)
    whole = p.call()
    more = [x.reshape(2, 3, *x.shape[1:]) for x in (p.normal, p.view, p.light, p.roughness, p.f0)]
    torch.testing.assert_close(GGX_specular(*more).reshape(whole.shape), whole)
    flipped = GGX_specular(-p.normal, p.view, p.light, p.roughness, p.f0)
    assert bool((whole > 0).any())
    torch.testing.assert_close(flipped, whole)
    for bounces in ("all", 1):
        number = GGX_specular(p.normal, p.view, p.light, 0.5, 0.04, bounces=bounces)
        maps = GGX_specular(
            p.normal, p.view, p.light, torch.full((N, 1), 0.5), torch.full((N, 1), 0.04), bounces=bounces
        )
        assert number.shape == (N, L, 1)
        torch.testing.assert_close(number, maps, rtol=1e-6, atol=1e-7)
    colour = GGX_specular(p.normal, p.view, p.light, p.roughness, torch.tensor([0.9, 0.6, 0.2]))
    assert colour.shape == (N, L, 3)


@pytest.mark.usefixtures("messages")
def test_what_is_refused(generator):
    p = Points.drawn(generator)
    with pytest.raises(ValueError, match=r'bounces=...\) must be "all", or 1 for the formula that it replaces; got 2'):
        p.call(bounces=2)
    with pytest.raises(ValueError, match=r"roughness=...\) must be \(\*batch, 1\).*Give it as roughness\[..., None\]"):
        GGX_specular(p.normal, p.view, p.light, p.roughness[:, 0], p.f0)
    with pytest.raises(ValueError, match=r"fresnel=...\) must be \(\*batch, C\) with the batch \(6,\)"):
        GGX_specular(p.normal, p.view, p.light, p.roughness, p.f0[:, None])
    with pytest.raises(ValueError, match=r"normal must be \(\*batch, 3\).*One light a point is"):
        GGX_specular(p.normal, p.view, p.light[:, 0], p.roughness, p.f0)
    with pytest.raises(ValueError, match=r"roughness=...\) must lie in \[0, 1\]; got 1.5"):
        GGX_specular(p.normal, p.view, p.light, p.roughness * 0 + 1.5, p.f0)
    with pytest.raises(TypeError, match=r"fresnel=...\) must be a number"):
        GGX_specular(p.normal, p.view, p.light, p.roughness, "gold")
    maps = (p.f0, p.f0, p.normal, p.normal, p.view, p.view)
    with pytest.raises(ValueError, match=r'bsdf=...\) must be "lambert"; got .frostbite.'):
        pbr_bsdf(*maps, bsdf="frostbite")
    with pytest.raises(ValueError, match=r"min_roughness=...\) must lie in \[0, 1\]; got 2"):
        pbr_bsdf(*maps, 2)
    with pytest.raises(ValueError, match=r"arm must be \(\*batch, 3\)"):
        pbr_bsdf(p.f0, p.roughness, *maps[2:])
    with pytest.raises(ValueError, match=r"light_type=...\) must be one of directional, point; got .sun."):
        CookTorranceBRDF("sun")
    without = material(generator)
    del without.metallic
    light = torch.ones(3).double()
    with pytest.raises(ValueError, match="must have a map called metallic or specular"):
        CookTorranceBRDF()(without, light, light, light)
    without.linear_specular = without.linear_albedo
    with pytest.raises(ValueError, match=r"material.to_basecolor_metallic_material\(\), or take bounces=1"):
        CookTorranceBRDF()(without, light, light, light)


COMPILED = """
import torch
from torchms.dropins import GGX_specular, pbr_bsdf
g = torch.Generator().manual_seed(1)
n, v, f = (torch.rand(4, 3, generator=g) for _ in range(3))
d, r = torch.rand(4, 7, 3, generator=g), 0.2 + 0.8 * torch.rand(4, 1, generator=g)
def both(n, v, d, r, f):
    return GGX_specular(n, v, d, r, f, bounces=1), pbr_bsdf(f, f, n, n, n + v, n + d[:, 0], bounces=1)
for ours, theirs in zip(torch.compile(both, fullgraph=True, backend="aot_eager")(n, v, d, r, f), both(n, v, d, r, f)):
    torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-5)
"""


@pytest.mark.slow
def test_the_formulas_are_one_graph():
    # In a process of its own: the run-time type checks of this one would break the graph.
    done = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_compiled(generator):
    """All bounces as machine code, values and gradients."""
    from torchms.bsdfs import compile as code

    if code._missing_compiler():
        pytest.skip("torchms.compile needs a C++ compiler")
    p = Points.drawn(generator)
    for name, x in vars(p).items():
        setattr(p, name, x.float().requires_grad_())
    leaves = list(vars(p).values())
    eager, fast = p.call(), p.call(compiled=True)
    torch.testing.assert_close(fast, eager, rtol=1e-4, atol=1e-5)
    found, expected = (torch.autograd.grad(value.sum(), leaves) for value in (fast, eager))
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-3)
    arguments = (p.f0, p.f0, p.normal, p.normal, p.normal + p.view, p.normal + p.light[:, 0])
    torch.testing.assert_close(pbr_bsdf(*arguments, compiled=True), pbr_bsdf(*arguments), rtol=1e-4, atol=1e-5)
