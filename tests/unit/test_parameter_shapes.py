"""Shapes of parameters beside directions: what can only mean one thing is taken, what may mean two is refused."""

import pytest
import torch
from cases import METHODS, directions, each
from torch import Tensor, nn

from torchms import GGX, GTR, Beckmann, RoughConductor, RoughDielectric, RoughDiffuse, SingleBounce, Stream, constrain
from torchms.fresnel import Conductor, Dielectric, Fresnel, Schlick

pytestmark = pytest.mark.usefixtures("messages")
H = W = 6


@pytest.fixture
def pictures(generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """α (H, W), and wi and wo (H, W, 3): a square, where a wrong reading broadcasts."""
    alpha = 0.2 + 0.7 * torch.rand(H, W, generator=generator)
    wi, wo = (directions(H * W, generator, 0.1, torch.float32).reshape(H, W, 3) for _ in range(2))
    return alpha, wi, wo


@each("method", METHODS)
def test_a_trailing_channel_of_a_map(method, pictures):
    """(H, W, 1) is (H, W), in every method, with its gradient; the surface keeps what it was given."""
    alpha, wi, wo = pictures
    given = alpha[..., None].clone().requires_grad_()
    surface = RoughConductor(GGX(given), Conductor.metal("Cu"), SingleBounce())
    expected = RoughConductor(GGX(alpha), Conductor.metal("Cu"), SingleBounce())
    found = METHODS[method](surface, wi, wo, Stream(1, 2))
    for a, b in zip(found, METHODS[method](expected, wi, wo, Stream(1, 2)), strict=True):
        assert torch.equal(a, b)
    assert surface.distribution.alpha is given
    found[-1].sum().backward() if found[-1].requires_grad else None
    assert given.grad is None or given.grad.shape == (H, W, 1)


def test_other_batches_are_taken_at_their_word(pictures):
    """A map beside one direction, and beside a batch that it does not repeat."""
    alpha, wi, wo = pictures
    surface = RoughConductor(GGX(alpha[..., None]), Conductor.metal("Cu"), SingleBounce())
    assert surface(wi[0, 0], wo[0, 0]).shape == (H, W, 1, 3)
    assert surface(wi[0, :4], wo[0, :4]).shape == (H, W, 4, 3)


def test_an_oblong_map_with_a_trailing_channel(pictures):
    """Which would not broadcast at all; that of glass and of a constrained parameter as well."""
    alpha, wi, wo = (x[:, :4] for x in pictures)
    glass = RoughDielectric(Beckmann(alpha[..., None]), Dielectric(1.2 + alpha[..., None]), SingleBounce())
    expected = RoughDielectric(Beckmann(alpha), Dielectric(1.2 + alpha), SingleBounce())
    assert torch.equal(glass(wi, wo), expected(wi, wo))
    constrain(glass, "distribution.alpha")
    torch.testing.assert_close(glass(wi, wo), expected(wi, wo), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda facets, w: facets.D(w),
        lambda facets, w: facets.Lambda(w),
        lambda facets, w: facets.D_visible(w, w),
        lambda facets, w: facets.sample_visible(w, torch.full((*w.shape[:-1], 2), 0.4)),
        lambda facets, w: facets.D_bounded(w, w),
        lambda facets, w: facets.sample_bounded(w, torch.full((*w.shape[:-1], 2), 0.4)),
    ],
)
def test_the_methods_of_a_distribution(call, pictures):
    alpha, w, _ = pictures
    assert torch.equal(call(GGX(alpha[..., None]), w), call(GGX(alpha), w))
    with pytest.raises(
        ValueError, match=r"alpha of shape \(6, 1\) beside a batch \(6,\).*alpha\.squeeze\(-1\).*w\[None\]"
    ):
        call(GGX(alpha[:, :1]), w[:, 0])
    # What the message advises.
    assert call(GGX(alpha[:, :1]), w[None, :, 0]).shape[:2] == (H, H)


def test_a_column_beside_as_many_directions_is_refused(pictures):
    alpha, wi, wo = pictures
    surface = RoughDiffuse(GTR(alpha[:, :1], 1.5), 0.5, SingleBounce())
    with pytest.raises(ValueError, match=r"distribution\.alpha of shape \(6, 1\) beside a batch \(6,\)"):
        surface(wi[0], wo[0], Stream(1))
    assert surface(wi[0, :5], wo[0, :5], Stream(1)).shape == (H, 5, 1)


GRAY = {
    "Schlick": lambda value: Schlick(value),
    "Conductor": lambda value: Conductor(0.2 + value, 3.0),
}


@each("name", GRAY)
def test_a_gray_map_is_not_a_row_of_channels(name, pictures):
    """(H, W) beside (H, W), square or not: refused, with the ways to write what is meant, which work."""
    gray, wi, wo = pictures
    make = GRAY[name]
    said = r" of shape \(6, 6\) beside a batch \(6, 6\) is 6 channels .*\[\.\.\., None\].*\[:, None\].*\[None\]"
    with pytest.raises(ValueError, match=said):
        RoughConductor(GGX(0.5), make(gray), SingleBounce())(wi, wo)
    with pytest.raises(ValueError, match=said):
        make(gray)(gray)
    with pytest.raises(ValueError, match=r"is 4 channels of a batch \(6,\)"):
        make(gray[:, :4])(gray[:, :4])
    fresnel: Fresnel = make(gray[..., None])
    assert fresnel(gray).shape == (H, W, 1)
    assert RoughConductor(GGX(0.5), fresnel, SingleBounce())(wi, wo).shape == (H, W, 1)
    torch.testing.assert_close(fresnel(gray)[2, 3], make(gray[2, 3, None])(gray[2, 3]))
    assert make(gray[:, None])(gray).shape == make(gray[None])(gray).shape == (H, W, W)
    assert make(gray[:1])(gray[:1]).shape == (1, W, W) and make(gray[0])(gray).shape == (H, W, W)


LISTS = {
    "two roughnesses": (lambda: GGX([0.3, 0.4]), r"Write GGX\(0\.3, 0\.4\) for alpha and alpha_y, torch\.tensor\("),
    "as a tuple": (lambda: Beckmann((0.3, 0.4)), r"Write Beckmann\(0\.3, 0\.4\) for"),
    "alpha_y": (lambda: GGX(0.3, [0.4]), r"GGX\(alpha_y=\.\.\.\) must be one number.*Write torch\.tensor\(\[0\.4\]\)"),
    "three": (lambda: GGX([0.3, 0.4, 0.5]), r"got \[0\.3, 0\.4, 0\.5\]\. Write torch\.tensor"),
    "an index": (lambda: Dielectric([1.5, 1.6]), r"Write torch\.tensor\(\[1\.5, 1\.6\]\) for a batch"),
    "gamma": (lambda: GTR(0.3, [2.0]), r"GTR\(gamma=\.\.\.\) must be one number"),
}


@each("case", LISTS)
def test_a_list_is_no_number(case):
    make, said = LISTS[case]
    with pytest.raises(TypeError, match=said):
        make()
    assert GGX(torch.tensor([0.3, 0.4])).alpha.shape == (2,) and Schlick([0.3, 0.4]).n_channels == 2


MOVED = {"negative": -0.1, "zero": 0.0, "large": 2.1, "NaN": torch.nan}


@each("method", METHODS)
@each("bad", MOVED)
def test_a_parameter_that_left_its_range(bad, method, pictures):
    """Through `.data`, as an optimizer does it, in one element of a map; unchecked it is used as it is."""
    from torchms import set_validation

    alpha, wi, wo = pictures
    surface = RoughConductor(GGX(nn.Parameter(alpha)), Conductor.metal("Cu"), SingleBounce())
    METHODS[method](surface, wi, wo, Stream(1, 2))
    surface.distribution.get_parameter("alpha").data[2, 3] = MOVED[bad]
    said = r"distribution\.alpha of this RoughConductor must lie in \[0\.001, 2\]; got .* at index \(2, 3\)\."
    with pytest.raises(ValueError, match=said + r".*constrain\(bsdf, 'distribution\.alpha'\).*set_validation\(False\)"):
        METHODS[method](surface, wi, wo, Stream(1, 2))
    before = set_validation(False)
    try:
        METHODS[method](surface, wi, wo, Stream(1, 2))
    finally:
        set_validation(before)


def test_the_ends_of_a_range_belong_to_it():
    """As float32 rounds them, too; and the open end does not."""
    wi = torch.tensor([0.6, 0.0, 0.8])
    for dtype in (torch.float32, torch.float64):
        ends = torch.tensor([1e-3, 2.0], dtype=dtype)
        surface = RoughConductor(GGX(ends), Schlick(torch.tensor([0.0, 1.0], dtype=dtype)), SingleBounce())
        assert surface(wi.to(dtype), wi.to(dtype)).shape == (2, 2)
    surface = RoughConductor(GTR(0.5, 1.0), Schlick(0.5), SingleBounce())
    surface.distribution.get_buffer("gamma").zero_()
    with pytest.raises(ValueError, match=r"distribution\.gamma .* must lie in \(0, 10\]; got 0"):
        surface(wi, wi)


def test_a_map_of_as_many_axes_as_the_batch_broadcasts_as_it_stands():
    """(N, N, 1) beside (N, N, N) is one number for the last axis, (N, N) one for the first."""
    n = 2
    alpha = torch.tensor([[0.2, 0.4], [0.6, 0.8]])
    w = torch.tensor([0.6, 0.0, 0.8]).expand(n, n, n, 3)
    value = [RoughConductor(GGX(map), Schlick(1.0), SingleBounce())(w, w)[..., 0] for map in (alpha[..., None], alpha)]
    assert torch.equal(value[0], value[0][..., :1].expand(n, n, n)) and torch.equal(
        value[1], value[1][:1].expand(n, n, n)
    )
    assert torch.equal(value[0][..., 0], value[1][0]) and float(value[1][0].std()) > 0
