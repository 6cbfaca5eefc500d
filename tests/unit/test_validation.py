"""The checked mode: directions that are none are refused with name, value and remedy; unchecked, they harm no neighbour."""

import copy
import math
from collections.abc import Iterator

import pytest
import torch
from cases import METHODS, bsdf, direction, directions, each, models
from torch import Tensor
from torch.func import jacrev, vmap

import torchms
from torchms import BSDF

BAD = {
    "NaN": (math.nan, 0.0, 1.0),
    "infinite": (math.inf, 0.0, 1.0),
    "zero": (0.0, 0.0, 0.0),
    "long": (0.6, 0.0, 0.9),
    "short": (0.0, 0.0, 0.999),
}


@pytest.fixture
def unchecked() -> Iterator[None]:
    before = torchms.set_validation(False)
    yield
    torchms.set_validation(before)


def spoilt(bad: str, generator: torch.Generator) -> tuple[BSDF, Tensor, Tensor, Tensor, Tensor]:
    """A surface, good directions, their spoilt copy (row 4 of 2 × 3), more good ones, and numbers."""
    surface = bsdf("conductor[conductor]", "invariance", max_order=2)
    wi, wo = (directions(6, generator, 0.1).reshape(2, 3, 3) for _ in range(2))
    spoilt = wi.clone()
    spoilt[1, 1] = torch.tensor(BAD[bad])
    return surface, wi, spoilt, wo, surface.uniforms((2, 3), 2, generator=generator)


@pytest.mark.usefixtures("messages")
@each("method", METHODS)
@each("bad", BAD)
def test_refused_with_name_value_index_and_remedy(method, bad, generator):
    surface, _, wi, wo, u = spoilt(bad, generator)
    with pytest.raises(
        ValueError, match=r"wi must hold unit vectors.*got .* at index \(1, 1\).*normalize\(wi.*set_val"
    ):
        METHODS[method](surface, wi, wo, u)
    if method in ("forward", "orders", "pdf"):
        with pytest.raises(ValueError, match=r"wo must hold unit vectors"):
            METHODS[method](surface, wo, wi, u)


@each("bad", BAD)
@models(["conductor[conductor]", "dielectric", "diffuse"], ["single", "height-walk"])
def test_unchecked_the_neighbours_keep_their_bits(bad, material, scattering, generator, unchecked):
    """Of every method; and no row becomes infinite work or an exception."""
    surface = bsdf(material, scattering, max_order=2)
    wi, wo = directions(6, generator, 0.1), directions(6, generator, 0.1)
    u = surface.uniforms((6,), 2, generator=generator)
    broken = wi.clone()
    broken[3] = torch.tensor(BAD[bad])
    others = torch.arange(6) != 3
    for method in METHODS.values():
        for good, found in zip(method(surface, wi, wo, u), method(surface, broken, wo, u), strict=True):
            assert torch.equal(good[others], found[others])


@each("bad", BAD)
def test_unchecked_the_neighbours_keep_their_gradients(bad, generator, unchecked):
    """Of their own directions and of a map of parameters."""
    surface = bsdf("conductor[conductor]", "invariance", max_order=2)
    others = torch.arange(6) != 3
    good = directions(6, generator, 0.1)
    wo, u = directions(6, generator, 0.1), surface.uniforms((6,), 2, generator=generator)
    broken = good.clone()
    broken[3] = torch.tensor(BAD[bad])
    found = []
    for wi in (good, broken):
        here = copy.deepcopy(surface)
        alpha = torch.full((6,), 0.6, dtype=torch.float64, requires_grad=True)
        here.distribution.alpha = alpha
        wi = wi.clone().requires_grad_()
        found.append([g[others] for g in torch.autograd.grad(here(wi, wo, u).sum(), [wi, alpha])])
    assert all(torch.equal(a, b) and bool(a.isfinite().all()) for a, b in zip(*found, strict=True))


def test_rounding_is_forgiven(generator):
    """Unit vectors in every dtype, and a little off; strides and broadcast axes make no difference."""
    surface = bsdf("conductor[conductor]", "single", dtype=torch.float32)
    w = directions(500, generator, 0.1)
    for dtype in (torch.float16, torch.bfloat16, torch.float32, torch.float64):
        surface.pdf(w.to(dtype), w.to(dtype))
    surface.pdf(w * 1.0004, w.T.contiguous().T)
    surface.pdf(direction(0.3).expand(7, 500, 3), w)
    wrong = (2 * direction(0.3)).expand(7, 500, 3)
    with pytest.raises(ValueError, match=r"got 4 at index \(0, 0\)"):
        surface.pdf(wrong, w)
    with pytest.raises(ValueError, match=r"wi must hold unit vectors"):
        surface.pdf(w.repeat(100, 1).index_fill(0, torch.tensor(49_999), 0.0), direction(0.3))
    assert surface.pdf(w[:0], w[:0]).shape == (0,)


def test_off_and_on_again():
    wrong = direction(0.5) * 2
    surface = bsdf("conductor[conductor]", "single")
    assert torchms.set_validation(False) is True
    try:
        assert surface.pdf(wrong, wrong).shape == ()
        assert torchms.set_validation(True) is False
    finally:
        torchms.set_validation(True)
    with pytest.raises(ValueError, match="unit vectors"):
        surface.pdf(wrong, wrong)


@pytest.mark.usefixtures("messages")
def test_the_switch_wants_a_bool():
    with pytest.raises(TypeError, match="must be True or False; got 0"):
        torchms.set_validation(0)


def test_transforms_and_fake_tensors_pass():
    """Directions without known values: under vmap and jacrev, and as fake tensors."""
    surface = bsdf("conductor[conductor]", "single")
    wo, w = direction(1.0), torch.stack([direction(0.3), direction(0.6)])
    torch.testing.assert_close(vmap(lambda d: surface.pdf(d, wo))(w), surface.pdf(w, wo))
    assert jacrev(lambda d: surface.pdf(d, wo))(w[0]).shape == (3,)
    with torch._subclasses.FakeTensorMode(allow_non_fake_inputs=True) as mode:
        assert surface.pdf(mode.from_tensor(w), mode.from_tensor(w)).shape == (2,)
