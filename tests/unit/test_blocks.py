"""Evaluation in blocks: how a batch is cut changes no number."""

import math
from unittest.mock import MagicMock

import pytest
import torch
from cases import METHODS, bsdf, direction, directions, each, models
from torch import nn

from torchms import GGX, Invariance, RoughConductor, RoughDielectric, RoughDiffuse, Uncorrelated, Unidirectional
from torchms.bsdfs.compile import Engine
from torchms.evaluation import blocks
from torchms.fresnel import Conductor, Dielectric, Schlick

SMALL = (1, 3, 7)


def same(actual, expected):
    for a, b in zip(actual, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-15)


@each("method", METHODS)
@models()
def test_blocks_change_nothing(method, material, scattering, generator, monkeypatch):
    """Rows and paths cut into blocks of 1, 3 and 7."""
    surface = bsdf(material, scattering, max_order=2)
    wi, wo = directions(5, generator), directions(5, generator)
    u = surface.uniforms((5,), 4, generator=generator)
    whole = METHODS[method](surface, wi, wo, u)
    for size in SMALL:
        monkeypatch.setattr(blocks, "BLOCK", size)
        same(METHODS[method](surface, wi, wo, u), whole)


def called(surface, method, block):
    """A method's result at some rows, by its own argument `block`."""
    generator = torch.Generator().manual_seed(0)
    wi, wo = directions(5, generator), directions(5, generator)
    u = surface.uniforms((5,), 4, generator=generator)
    given = {"forward": (wi, wo, u), "orders": (wi, wo, u), "pdf": (wi, wo)}.get(method, (wi, u))
    found = getattr(surface, method if method != "forward" else "__call__")(*given, block=block)
    return found if isinstance(found, tuple) else (found,)


@each("method", METHODS)
def test_the_block_is_an_argument(method, monkeypatch):
    """Every method takes it and cuts by it, with the results of the default."""
    surface = bsdf("conductor[conductor]", "bidirectional-invariance", max_order=2)
    whole = called(surface, method, None)
    paths = 1 if method == "pdf" else 4
    counted = MagicMock(wraps=blocks._components)
    monkeypatch.setattr(blocks, "_components", counted)
    for size in (*SMALL, 10, 1000):
        counted.reset_mock()
        same(called(surface, method, size), whole)
        assert counted.call_count == math.ceil(5 / max(1, size // paths))


@each("method", METHODS)
@pytest.mark.parametrize("block", [0, -8, True], ids=str)
def test_no_block_of_no_size(method, block):
    with pytest.raises((TypeError, ValueError), match=rf"{method}\(block=...\) must be .*; got {block}"):
        called(bsdf("conductor[conductor]", "single"), method, block)


def test_compiled_code_takes_no_block():
    surface = bsdf("conductor[conductor]", "single")
    surface.engine = Engine(verbose=False)
    with pytest.raises(
        ValueError, match=r"forward\(block=64\): compiled code runs in blocks of the size .* Leave block"
    ):
        called(surface, "forward", 64)


@each("method", METHODS)
def test_a_row_is_what_it_is_alone(method, generator):
    """No row of a batch depends on another one, per-pixel parameters included."""
    alpha = torch.rand(6, generator=generator, dtype=torch.float64) + 0.1
    f0 = torch.rand(6, 3, generator=generator, dtype=torch.float64)
    wi, wo = directions(6, generator, 0.1), directions(6, generator, 0.1)
    surface = RoughConductor(GGX(alpha), Schlick(f0), Unidirectional(Invariance()))
    u = surface.uniforms((6,), 3, generator=generator)
    together = METHODS[method](surface, wi, wo, u)
    for i in range(6):
        alone = RoughConductor(GGX(alpha[i]), Schlick(f0[i]), Unidirectional(Invariance()))
        same(METHODS[method](alone, wi[i], wo[i], u[i]), [x[i] for x in together])


@each("method", METHODS)
@pytest.mark.parametrize("batch", [(), (0,), (2, 3), (2, 0, 3), (1,)], ids=str)
@models(["conductor[conductor]", "dielectric"], ["invariance", "height-walk"])
def test_shapes(method, batch, material, scattering, generator):
    """(*batch, C), (*batch, K, C), (*batch, N, 3), …, down to no row and no batch axis at all."""
    surface = bsdf(material, scattering, max_order=2)
    n = torch.Size(batch).numel()
    wi, wo = (directions(n, generator).reshape(*batch, 3) for _ in range(2))
    results = METHODS[method](surface, wi, wo, surface.uniforms(batch, 4, generator=generator))
    C, K = surface.n_channels, 2
    expected = {
        "forward": [(C,)],
        "orders": [(K, C)],
        "sample": [(4, 3), (4,)],
        "pdf": [()],
        "sample_walk": [(4, 3), (4, C), (4,)],
        "albedo": [(K, C), (K, C)],
    }
    assert [tuple(x.shape) for x in results] == [(*batch, *tail) for tail in expected[method]]


@each("method", METHODS)
def test_everything_broadcasts(method, generator):
    """wi (3, 1), wo (1, 4), u (2, 1, 1), α (4), f0 (3, 1, C): a batch of (2, 3, 4), the same as expanded by hand."""
    wi = directions(3, generator, 0.1).reshape(3, 1, 3)
    wo = directions(4, generator, 0.1).reshape(1, 4, 3)
    alpha = torch.rand(4, generator=generator, dtype=torch.float64) + 0.1
    f0 = torch.rand(3, 1, 2, generator=generator, dtype=torch.float64)
    surface = RoughConductor(GGX(alpha), Schlick(f0), Unidirectional(Invariance()))
    u = surface.uniforms((2, 1, 1), 3, generator=generator)
    batch = (2, 3, 4)
    f0_by_hand = Schlick(f0.expand(*batch, 2).clone())
    by_hand = RoughConductor(GGX(alpha.expand(batch).clone()), f0_by_hand, Unidirectional(Invariance()))
    full = (wi.expand(*batch, 3).clone(), wo.expand(*batch, 3).clone(), u.expand(*batch, *u.shape[-2:]).clone())
    ours, expected = METHODS[method](surface, wi, wo, u), METHODS[method](by_hand, *full)
    if method == "pdf":  # which takes no u
        expected = [x[0] for x in expected]
    same(ours, expected)


@each("method", METHODS)
def test_strides_do_not_matter(method, generator):
    surface = bsdf("dielectric", "height-walk")
    wi, wo = directions(6, generator), directions(6, generator)
    u = surface.uniforms((6,), 3, generator=generator)
    strided = [x.repeat_interleave(2, 0)[::2] for x in (wi.T.contiguous().T, wo, u.contiguous())]
    assert not strided[0].is_contiguous()
    same(METHODS[method](surface, *strided), METHODS[method](surface, wi, wo, u))


def test_paths_are_averaged(generator):
    """N paths give the mean of N calls with one path each."""
    surface = bsdf("diffuse", "invariance")
    wi, wo = direction(0.5), direction(1.0, 2.0)
    u = surface.uniforms((), 16, generator=generator)
    each_path = torch.stack([surface.orders(wi, wo, u[i : i + 1]) for i in range(16)])
    torch.testing.assert_close(surface.orders(wi, wo, u), each_path.mean(0))
    torch.testing.assert_close(surface(wi, wo, u), each_path.mean(0).sum(0))


@pytest.mark.parametrize("size", SMALL)
@models()
def test_gradients_pass_through_blocks(size, material, scattering, generator, monkeypatch):
    """Of per-pixel and shared parameters and of directions, whatever the cut."""
    wi, wo = directions(4, generator, 0.2).requires_grad_(), directions(4, generator, 0.2).requires_grad_()
    surface = bsdf(material, scattering, max_order=2)
    u = surface.uniforms((4,), 3, generator=generator)
    surface.distribution.alpha = torch.full((4,), 0.6, dtype=torch.float64, requires_grad=True)
    leaves = [wi, wo, surface.distribution.alpha, surface.distribution.alpha_y.requires_grad_()]

    def gradients():
        return torch.autograd.grad(surface(wi, wo, u).sum(), leaves)

    whole = gradients()
    monkeypatch.setattr(blocks, "BLOCK", size)
    same(gradients(), whole)


@pytest.mark.parametrize("channels", [1, 3, 31])
def test_channels(channels, generator):
    """C is whatever the material has, and each channel is what it is alone."""
    values = torch.linspace(0.1, 0.9, channels, dtype=torch.float64)
    wi, wo = direction(0.5), direction(1.0, 2.0)
    for make in (
        lambda x: RoughConductor(GGX(0.5), Schlick(x)).double(),
        lambda x: RoughConductor(GGX(0.5), Conductor(x, 3 * x)).double(),
        lambda x: RoughDiffuse(GGX(0.5), x, Unidirectional(Uncorrelated(), 3)).double(),
    ):
        surface = make(values)
        u = surface.uniforms((), 2, generator=generator)
        value = surface.orders(wi, wo, u)
        assert value.shape[-1] == channels == surface.n_channels
        assert surface.sample_walk(wi, u).weight.shape == (2, channels)
        for i in {0, channels // 2, channels - 1}:
            torch.testing.assert_close(make(values[i : i + 1]).orders(wi, wo, u), value[..., i : i + 1])


def test_maps_of_every_parameter(generator):
    """α, η, k, the albedo and glass's η per pixel (2, 3), each pixel what it is alone."""
    shape = (2, 3)
    wi, wo = (directions(6, generator, 0.1).reshape(*shape, 3) for _ in range(2))
    a, b, c = (0.1 + torch.rand(3, *shape, generator=generator, dtype=torch.float64)).unbind(0)
    for make in (
        lambda i: RoughConductor(
            GGX(a[i], b[i]), Conductor(b[i][..., None], c[i][..., None]), Unidirectional(Invariance())
        ),
        lambda i: RoughDielectric(GGX(a[i]), Dielectric(1.1 + c[i])),
        lambda i: RoughDiffuse(GGX(a[i]), c[i][..., None].clamp_max(1), Unidirectional(Invariance())),
    ):
        surface = make(...)
        u = surface.uniforms(shape, 2, generator=generator)
        value = surface(wi, wo, u)
        for i in ((0, 0), (1, 2)):
            torch.testing.assert_close(make(i)(wi[i], wo[i], u[i]), value[i])


def test_a_trained_map_gets_gradients(generator):
    """An nn.Parameter per pixel, over several blocks."""
    alpha = nn.Parameter(torch.full((3, 4), 0.4, dtype=torch.float64))
    surface = RoughConductor(GGX(alpha), Schlick(0.5)).double()
    wi = direction(0.7)
    surface(wi, wi, surface.uniforms((3, 4), 2, generator=generator)).sum().backward()
    assert alpha.grad is not None
    assert alpha.grad.shape == (3, 4) and (alpha.grad != 0).all()
