"""Tabulated: the laws, its closed forms against others', and what it makes of heights, slopes and histograms."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.special
import torch
from cases import METHODS, direction, directions, tabulated
from torch import Tensor, nn

import torchms
from torchms import (
    GGX,
    Beckmann,
    HeightWalk,
    Invariance,
    RoughConductor,
    RoughDiffuse,
    SingleBounce,
    Tabulated,
    Unidirectional,
)
from torchms.cli.expression import parse_bsdf
from torchms.distributions import MicrofacetDistribution
from torchms.fresnel import Ideal
from torchms.maths.frame import split
from torchms.microsurface import Heightfield
from torchms.slopes.heights import facet_slopes
from torchms.testing import estimate, exactly, law_suite, p_value, zscore

F64 = torch.float64


def test_obeys():
    report = law_suite(tabulated(0.6, 0.3), samples=20_000)
    assert not report.failed, str(report)
    assert len(report.laws) == 15


@pytest.mark.parametrize(
    "surface",
    [
        lambda d: RoughConductor(d, Ideal(), Unidirectional(Invariance(), 3)),
        pytest.param(lambda d: RoughDiffuse(d, 0.9, HeightWalk(3)), marks=pytest.mark.slow),
    ],
    ids=["metal", "chalk"],
)
def test_surfaces_obey(surface):
    report = law_suite(surface(tabulated(0.6, 0.3)), samples=4_000)
    assert not report.failed, str(report)


def values(d: MicrofacetDistribution, generator: torch.Generator) -> list[Tensor]:
    w, m, u = directions(300, generator), directions(300, generator), torch.rand(300, 2, generator=generator, dtype=F64)
    return [d.D(m), d.Lambda(w), d.D_visible(w, m), d.sample_visible(w, u), d.mean_alpha2]


def test_one_component_is_beckmann(generator):
    """Turned and scaled, too: a covariance that leans is an ellipse along other axes."""
    seed = int(torch.randint(1 << 30, (1,), generator=generator))
    one = Tabulated([3.0], [[0.0, 0.0]], [[[0.18, 0], [0, 0.32]]]).double()
    both = zip(
        *(values(d, torch.Generator().manual_seed(seed)) for d in (one, Beckmann(0.6, 0.8).double())), strict=True
    )
    for mine, theirs in both:
        torch.testing.assert_close(mine, theirs, rtol=1e-6, atol=1e-9)  # float32 tables
    c, s = 0.6, 0.8
    turn = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=F64)
    R = turn[:2, :2].numpy()
    leaning = Tabulated([1.0], [[0.0, 0.0]], [R @ np.diag([0.18, 0.32]) @ R.T]).double()
    w, m = directions(100, generator), directions(100, generator)
    torch.testing.assert_close(leaning.Lambda(w), one.Lambda(w @ turn), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(leaning.D_visible(w, m), one.D_visible(w @ turn, m @ turn), rtol=1e-5, atol=1e-6)


def test_a_mixture_of_the_same_is_it(generator):
    """Components beside each other, and the scale as the factor of all slopes."""
    seed = int(torch.randint(1 << 30, (1,), generator=generator))
    C = np.array([[0.1, 0.03], [0.03, 0.05]])
    one = Tabulated([1.0], [[0.0, 0.0]], [C], 1.4, 0.7).double()
    S = np.diag([1.4, 0.7])
    two = Tabulated([0.3, 0.7], np.zeros((2, 2)), [S @ C @ S] * 2).double()
    mine, theirs = (values(d, torch.Generator().manual_seed(seed)) for d in (one, two))
    for i in (0, 1, 2, 4):
        torch.testing.assert_close(mine[i], theirs[i], rtol=1e-5, atol=1e-6)


# From histograms.

EDGES = np.sinh(np.linspace(-9, 9, 121)) / 15
"""Bins as wide as slopes are large: 0.01 in the middle, and out to 270, as GGX has no end."""


def beckmann_counts(ax: float, ay: float) -> np.ndarray:
    x, y = (np.diff(scipy.special.erf(EDGES / a)) / 2 for a in (ax, ay))
    return np.outer(x, y)


def ggx_counts(ax: float, ay: float) -> np.ndarray:
    t, weight = np.polynomial.legendre.leggauss(6)
    middle, half = (EDGES[1:] + EDGES[:-1]) / 2, np.diff(EDGES) / 2
    s = middle[:, None] + half[:, None] * t
    x, y = (s / ax)[:, :, None, None], (s / ay)[None, None]
    density = 1 / (math.pi * ax * ay * (1 + x * x + y * y) ** 2)
    return np.einsum("iajb,a,b->ij", density, weight, weight) * np.outer(half, half)


@pytest.mark.parametrize(
    "family,counts,g1",
    [(Beckmann, beckmann_counts, 3e-4), (GGX, ggx_counts, 4e-3)],
    ids=["beckmann", "ggx"],
)
def test_the_histogram_of_a_closed_form_gives_it(family, counts, g1):
    """What is left is the bins', of 15 % of a slope; of GGX's tails, and its peak, what 16 Gaussians leave."""
    closed, made = family(0.5, 0.3).double(), Tabulated.from_histogram(1e6 * counts(0.5, 0.3), EDGES).double()
    w = torch.stack([direction(t, p) for t in (0.2, 0.8, 1.2, 1.5) for p in (0.0, 0.7, 1.6)])
    error = (1 / (1 + made.Lambda(w)) - 1 / (1 + closed.Lambda(w))).abs()
    assert float(error.max()) < g1
    m = torch.stack([direction(t, p) for t in (0.0, 0.2, 0.4, 0.6) for p in (0.0, 0.7, 1.6)])
    assert float(((made.D(m) - closed.D(m)).abs() / closed.D(m)).max()) < 0.08
    assert float((made.D(m) - closed.D(m)).abs().max() / closed.D(m).max()) < (1e-3 if family is Beckmann else 0.05)


def skewed(n: int = 40_000) -> np.ndarray:
    """Slopes like those of sawteeth: gentle one way, steep the other."""
    u = np.random.default_rng(5).random((n, 2))
    s = np.stack([-0.3 * np.log1p(-u[:, 0]), scipy.special.ndtri(u[:, 1]) * 0.2], 1)
    s[:, 1] += 0.3 * s[:, 0]
    return s - s.mean(0)


def test_slopes_that_lean_one_way():
    """Λ is that of the slopes themselves, on both sides, though they are not symmetric."""
    s = skewed()
    d = Tabulated.from_slopes(s + [0.4, -1.0]).double()  # a tilted sample is levelled
    assert len(d.mixture.weights) > 4
    np.testing.assert_allclose(d.mixture.weights @ d.mixture.means, 0, atol=1e-7)
    for theta in (0.5, 1.2, 1.5, 1.7, 2.2):
        for phi in (0.3, 0.3 + math.pi, 2.0):
            w = direction(theta, phi)
            area = np.maximum(float(w[2]) - s @ w[:2].numpy(), 0).mean()
            assert float(d.projected_area(split(w))) == pytest.approx(float(area), abs=1e-3)
    one_way, other = (d.Lambda(direction(1.2, phi)) for phi in (0.0, math.pi))
    assert float(one_way / other) > 1.2 or float(other / one_way) > 1.2


def test_weights_count_slopes_again():
    s = skewed(3_000)
    n = np.arange(len(s)) % 3
    twice, weighed = Tabulated.from_slopes(np.repeat(s, n, axis=0)), Tabulated.from_slopes(s, n)
    w = direction(1.3, dtype=torch.float32)
    assert float(twice.Lambda(w)) == pytest.approx(float(weighed.Lambda(w)), rel=2e-2)


def test_a_surface_has_a_distribution():
    surface = Heightfield.gaussian(0.5, 0.8, size=128, texels_per_correlation=8, seed=1)
    d = surface.distribution(components=4)
    for mine, theirs in zip(d.alphas, surface.alpha, strict=True):
        assert float(mine) == pytest.approx(theirs, rel=1e-3)
    w = direction(1.2, dtype=torch.float32)
    slopes = facet_slopes(surface.heights, surface.spacing, periodic=True)
    area = np.maximum(float(w[2]) - slopes @ w[:2].numpy(), 0).mean()
    assert float(d.projected_area(split(w))) == pytest.approx(float(area), abs=1e-3)
    again = Tabulated.from_heights(2 * surface.heights, surface.spacing, periodic=True, components=4)
    d.scale = torch.tensor(2.0)
    assert float(again.Lambda(w)) == pytest.approx(float(d.Lambda(w)), rel=1e-3)


# Gradients.


def test_gradients():
    m = torch.stack([direction(0.4, 2.0), direction(0.9, 0.3)]).requires_grad_()
    w = torch.stack([direction(t, 0.7) for t in (0.0, 0.5, 1.5, 1.7, 2.3)])[:, None].requires_grad_()
    sx, sy = (torch.tensor(s, dtype=F64, requires_grad=True) for s in (0.8, 0.5))

    def check(f: Callable[..., Tensor], *x: Tensor) -> bool:
        return torch.autograd.gradcheck(f, x, eps=1e-7, atol=1e-5, rtol=1e-4)

    def at(sx: Tensor, sy: Tensor) -> MicrofacetDistribution:
        return tabulated(sx, sy).double()

    assert check(lambda m, sx, sy: at(sx, sy).D(m), m, sx, sy)
    assert check(lambda w, sx, sy: at(sx, sy).Lambda(w), w, sx, sy)
    assert check(lambda w, m, sx, sy: at(sx, sy).D_visible(w, m), w, m, sx, sy)


@pytest.mark.parametrize("theta", [0.0, 0.4, 1.3, 1.8])
def test_the_mean_gradient_of_samples_is_that_of_the_mean(theta, generator, budget):
    """By samples that move against samples that are held, which weigh by their density: every way to turn w, and scales."""
    n = 40_000
    x = torch.tensor([0.7, 0.5, 0.0, 0.0], dtype=F64).expand(n, 4).clone().requires_grad_()
    w = direction(theta).expand(n, 3)
    a, b = w[:, 0] * x[:, 2].cos() + w[:, 2] * x[:, 2].sin(), w[:, 2] * x[:, 2].cos() - w[:, 0] * x[:, 2].sin()
    w = torch.stack([a, w[:, 1] * x[:, 3].cos() - b * x[:, 3].sin(), w[:, 1] * x[:, 3].sin() + b * x[:, 3].cos()], -1)
    d = tabulated(x[:, 0], x[:, 1]).double()
    m = d.sample_visible(w, torch.rand(n, 2, generator=generator, dtype=F64))
    held = m.detach()
    density = d.D_visible(w, held)
    p = []
    for f in (lambda m: m[:, 2], lambda m: m[:, 0] * m[:, 2] + m[:, 1] ** 2, lambda m: torch.exp(m[:, 1])):
        (moved,) = torch.autograd.grad(f(m).sum(), x, retain_graph=True)
        (weighed,) = torch.autograd.grad((f(held) * density / density.detach()).sum(), x, retain_graph=True)
        p.append(p_value(zscore(estimate(moved - weighed), exactly(torch.zeros(())))))
    budget(torch.stack(p).reshape(-1))


@pytest.mark.parametrize(
    "scattering", [SingleBounce(), pytest.param(HeightWalk(3), marks=pytest.mark.slow)], ids=["single", "walk"]
)
def test_compiled_is_eager(scattering, generator, messages):
    surface = RoughConductor(tabulated(0.6), Ideal(), scattering)
    compiled = torchms.compile(surface)
    wi, wo = (directions(500, generator, 0.05, torch.float32) for _ in range(2))
    u = surface.uniforms((500,), 1, generator=generator)
    for method in ("forward", "sample"):
        eager, other = (list(METHODS[method](s, wi, wo, u)) for s in (surface, compiled))
        for x, y in zip(eager, other, strict=True):
            assert float(((x - y).abs() / (1e-2 + x.abs())).quantile(0.99)) < 1e-4


# Numbers, files and what is refused.


def test_parameters_stay_parameters_and_maps_broadcast():
    p = nn.Parameter(torch.tensor(0.4))
    d = tabulated(p)
    assert dict(d.named_parameters()) == {"scale": p} and set(d.state_dict()) == {"table", "scale"}
    w = direction(1.0, dtype=torch.float32).expand(4, 3)
    scale = torch.linspace(0.2, 0.8, 4)
    rows = tabulated(scale).Lambda(w)
    for i in range(4):
        torch.testing.assert_close(tabulated(scale[i]).Lambda(w[i]), rows[i])
    assert "scale=0.4" in repr(d)
    with pytest.raises(ValueError, match="is a map"):
        _ = tabulated(scale).mixture


def test_a_file_gives_it_back(tmp_path, messages):
    path = tmp_path / "scan.npz"
    d = tabulated(0.6, 0.3)
    d.save(path)
    again = Tabulated.load(path)
    w = direction(1.2, dtype=torch.float32)
    torch.testing.assert_close(again.Lambda(w), d.Lambda(w))
    on_the_command_line = parse_bsdf(f"RoughConductor(Tabulated.load({str(path)!r}), Ideal())")
    torch.testing.assert_close(on_the_command_line.distribution.Lambda(w), d.Lambda(w))
    with pytest.raises(FileExistsError):
        d.save(path)
    d.save(path, force=True)
    with pytest.raises(FileNotFoundError):
        Tabulated.load(tmp_path / "none.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="truncated"):
        Tabulated.load(path)
    np.savez(
        path, format=np.array(1), weights=np.ones(1), means=np.zeros((1, 2)), covariances=np.full((1, 2, 2), np.nan)
    )
    with pytest.raises(ValueError, match=r"scan\.npz: Tabulated.*finite"):
        Tabulated.load(path)
    np.savez(path, format=np.array(9))
    with pytest.raises(ValueError, match="of format 9"):
        Tabulated.load(path)


GOOD = ([0.5, 0.5], [[0.1, 0.0], [-0.1, 0.0]], [[[0.1, 0], [0, 0.1]]] * 2)


@pytest.mark.parametrize(
    "made,told",
    [
        (lambda: Tabulated(GOOD[0][:1], *GOOD[1:]), r"\(K,\), \(K, 2\) and \(K, 2, 2\).*\(1,\), \(2, 2\)"),
        (lambda: Tabulated([1.0, -0.5], *GOOD[1:]), r"weights=\.\.\.\) must be at least 0.*-0\.5"),
        (lambda: Tabulated([0.9, 0.1], *GOOD[1:]), r"means=\.\.\.\) must sum to 0.*Subtract"),
        (lambda: Tabulated(*GOOD[:2], [[[0.1, 0.2], [0.2, 0.1]]] * 2), r"covariances=\.\.\.\) must have variances in"),
        (lambda: Tabulated(*GOOD[:2], [[[0.1, 0.2], [0.0, 0.1]]] * 2), "symmetric"),
        (lambda: Tabulated(*GOOD, scale=0.0), r"scale=\.\.\.\) must lie in \[0\.01, 100\]; got 0"),
        (lambda: Tabulated.from_slopes(np.zeros((5, 2))), "A mirror or a groove is a limit"),
        (lambda: Tabulated.from_slopes(1e3 * skewed(50)), "different units"),
        (lambda: Tabulated.from_slopes(np.zeros((5, 3))), r"must be \(n, 2\)"),
        (lambda: Tabulated.from_slopes([[0.0, 1.0], [math.nan, 0.0]]), r"got nan at index \(1, 0\) \(1 of 4\)"),
        (lambda: Tabulated.from_slopes(skewed(9), np.ones(8)), r"weights=\.\.\.\) must have shape \(9,\)"),
        (
            lambda: Tabulated.from_slopes(skewed(9), components=0),
            r"components=\.\.\.\) must be an integer in \[1, 256\]",
        ),
        (lambda: Tabulated.from_histogram(np.ones((2, 3)), [0, 1, 2]), r"counts=\.\.\.\) must have shape \(2, 2\)"),
        (lambda: Tabulated.from_histogram(np.ones((2, 2)), [0, 2, 1]), r"edges_x=\.\.\.\) must increase"),
        (lambda: Tabulated.from_histogram(np.zeros((2, 2)), [0, 1, 2]), "not all 0"),
        (lambda: Tabulated.from_heights(np.ones((3, 9)), 1.0), "at least 4 x 4"),
        (lambda: Tabulated.from_heights(np.ones((9, 9)), -1.0), "spacing"),
    ],
)
def test_what_is_refused(made, told, messages):
    with pytest.raises(ValueError, match=told):
        made()
