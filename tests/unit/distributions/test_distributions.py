"""Every distribution: D, Λ and the visible normals, from above and from below the horizon."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.stats
import torch
from cases import ELLIPTIC, direction
from torch import Tensor, nn

from torchms.distributions import MicrofacetDistribution
from torchms.maths.frame import split
from torchms.parameters.exchange import with_parameters
from torchms.testing import chi_square, sphere_cells
from torchms.testing.chi_square import cell_index

F64 = torch.float64
DTYPES = [torch.float32, torch.float64]
BOTH = pytest.mark.parametrize("family", ELLIPTIC.values(), ids=ELLIPTIC.keys())
ALPHAS = [(1.0,), (0.25,), (0.5, 0.8), (1.0, 0.1)]


def build(family: type[MicrofacetDistribution], alpha: tuple[float, ...], dtype: torch.dtype = F64):
    return family(*(torch.tensor(a, dtype=dtype) for a in alpha))


def nodes(a: Tensor, b: Tensor, n: int) -> tuple[Tensor, Tensor]:
    """Gauss–Legendre in x ∈ [a, b] after x = a + (b − a) sin²(π t / 2), for square-root singularities at both ends."""
    t, w = (torch.from_numpy(x) for x in np.polynomial.legendre.leggauss(n))
    t, w = (t + 1) / 2, w / 2
    a, b = a[..., None], b[..., None]
    return a + (b - a) * torch.sin(math.pi / 2 * t) ** 2, (b - a) * w * math.pi / 2 * torch.sin(math.pi * t)


def facing_integral(function: Callable[[Tensor], Tensor], w: Tensor, n: int = 400) -> float:
    """∫ function(m) dm over the m with ⟨w, m⟩ > 0 and m_z > 0, in polar coordinates about w."""
    # m = (cos β) w + (sin β) (a cos ψ + b sin ψ), a the tangent at w towards +z: m_z > 0 bounds ψ.
    cos_w = float(w[2])
    sin_w = math.sqrt(1 - cos_w * cos_w)
    tangent = (torch.tensor([0.0, 0.0, 1.0], dtype=F64) - cos_w * w) / sin_w
    normal = torch.linalg.cross(w, tangent)
    kink = abs(math.pi / 2 - math.acos(cos_w))
    total = 0.0
    for low, high in ((0.0, kink), (kink, math.pi / 2)):
        beta, beta_weight = nodes(torch.tensor(low, dtype=F64), torch.tensor(high, dtype=F64), n)
        edge = torch.acos((-cos_w / sin_w / torch.tan(beta)).clamp(-1, 1))
        psi, psi_weight = nodes(-edge, edge, n)
        sin, cos = torch.sin(beta)[:, None, None], torch.cos(beta)[:, None, None]
        around = torch.cos(psi)[..., None] * tangent + torch.sin(psi)[..., None] * normal
        values = function(cos * w + sin * around) * sin[..., 0]
        total += float((beta_weight[:, None] * psi_weight * values).sum())
    return total


@BOTH
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_projected_normals_cover_the_surface(family, alpha):
    distribution = build(family, alpha)
    theta, theta_weight = nodes(torch.zeros((), dtype=F64), torch.tensor(math.pi / 2, dtype=F64), 200)
    phi = torch.arange(400, dtype=F64) * (2 * math.pi / 400)
    sin, cos = torch.sin(theta)[:, None], torch.cos(theta)[:, None]
    m = torch.stack([sin * torch.cos(phi), sin * torch.sin(phi), cos.expand(-1, 400)], -1)
    area = (distribution.D(m) * (sin * cos) * theta_weight[:, None]).sum() * (2 * math.pi / 400)
    assert float(area) == pytest.approx(1, abs=1e-9)


@BOTH
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", [0.3, 1.0, 1.5, 1.65, 2.0, 2.4])
def test_lambda_and_masking_are_the_integral_of_eq_4(family, alpha, theta):
    distribution = build(family, alpha)
    w = direction(theta)
    # [Wang2022] Eq. 4: G1_dist(w) = |cos θ| / ∫ ⟨w, m⟩ D dm, and it is 1 / |1 + Λ|.
    area = facing_integral(lambda m: distribution.D(m) * (m @ w), w)
    assert abs(math.cos(theta)) / area * float(distribution.blocking(split(-w))) == pytest.approx(1, abs=1e-6)
    assert float(distribution.projected_area(split(w))) == pytest.approx(area, rel=1e-6)
    # 1 + Λ itself cancels where it is small.
    assert float((1 + distribution.Lambda(w)).abs()) == pytest.approx(area / abs(math.cos(theta)), rel=1e-6, abs=1e-14)


@BOTH
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
@pytest.mark.parametrize("theta", [0.3, 1.0, 1.5, 1.65, 2.0, 2.4, 2.9])
def test_visible_normals_are_a_density(family, alpha, theta):
    distribution = build(family, alpha)
    w = direction(theta)
    assert facing_integral(lambda m: distribution.D_visible(w, m), w) == pytest.approx(1, abs=1e-6)


@BOTH
@pytest.mark.parametrize("alpha", ALPHAS, ids=str)
def test_lambda_of_the_opposite_direction(family, alpha):
    distribution = build(family, alpha)
    w = torch.stack([direction(t, p) for t in (0.01, 0.5, 1.0, 1.5, 1.57) for p in (0.0, 0.7, 4.0)])
    above, below = distribution.Lambda(w), distribution.Lambda(-w)
    torch.testing.assert_close(below, -1 - above, rtol=1e-13, atol=0)
    assert (above >= 0).all() and (below <= -1).all()


@BOTH
@pytest.mark.parametrize("alpha", [(0.5,), (2.0,), (1.0, 0.1), (0.05, 0.2)], ids=str)
def test_lambda_in_float32(family, alpha, generator):
    w = nn.functional.normalize(torch.randn(100_000, 3, generator=generator, dtype=F64), dim=-1).float()
    exact = family(*(torch.tensor(a).double() for a in alpha))
    double = w.double()
    s = exact.stretched(split(double))
    steepness = s.z.abs() / (s.x**2 + s.y**2).sqrt()
    error = (family(*alpha).Lambda(w).double() / exact.Lambda(double) - 1).abs()
    # Below |w_z| = 1e-7 float32 has the Λ of 1e-7; near it, w_z has few digits for no reason of ours.
    usual = w[:, 2].abs() > 1e-6
    assert float(error[usual & (steepness < 5)].max()) < 1e-5
    assert float(error[usual & (steepness < 8)].max()) < 2e-5


@BOTH
@pytest.mark.parametrize("dtype", DTYPES)
def test_equal_alphas_are_isotropic(family, dtype, generator):
    one, two = build(family, (0.3,), dtype), build(family, (0.3, 0.3), dtype)
    w, m = nn.functional.normalize(torch.randn(2, 200, 3, generator=generator, dtype=dtype), dim=-1)
    u = torch.rand(200, 2, generator=generator, dtype=dtype)
    assert torch.equal(one.D(m), two.D(m)) and torch.equal(one.Lambda(w), two.Lambda(w))
    assert torch.equal(one.sample_visible(w, u), two.sample_visible(w, u))
    # And a turn about z changes nothing.
    turn = torch.tensor([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]], dtype=dtype)
    tolerance = {torch.float32: 1e-4, torch.float64: 1e-12}[dtype]
    for value, turned in (
        (one.D(m), one.D(m @ turn.T)),
        (one.Lambda(w), one.Lambda(w @ turn.T)),
        (one.D_visible(w, m), one.D_visible(w @ turn.T, m @ turn.T)),
    ):
        torch.testing.assert_close(value, turned, rtol=tolerance, atol=tolerance)


# Visible normals.

VIEWS = [0.0, 0.8, 1.5, 1.6, 2.1, 2.6]


@BOTH
@pytest.mark.parametrize("alpha", [(1.0,), (0.4, 0.8), (1.0, 0.1)], ids=str)
@pytest.mark.parametrize("theta", VIEWS)
def test_visible_normals_have_their_density(family, alpha, theta, generator, budget):
    """Chi² over the sphere, and over the cells below 1 % of the peak alone."""
    distribution = build(family, alpha)
    w = direction(theta)
    n = 100_000
    m = distribution.sample_visible(w, torch.rand(n, 2, generator=generator, dtype=F64))
    torch.testing.assert_close(m.norm(dim=-1), torch.ones(n, dtype=F64), rtol=0, atol=1e-12)
    assert (m[:, 2] >= 0).all() and ((m @ w) > -1e-9).all()

    share = shares(distribution, w)
    counts = torch.bincount(cell_index(m, BINS), minlength=share.numel())
    p_values = [pearson(counts, share * n)]
    tail = share < 0.01 * share.max()
    if float(share[tail].sum()) * n > 50:
        within = share[tail] / share[tail].sum()
        p_values.append(pearson(counts[tail], within * counts[tail].sum()))
    budget(torch.tensor(p_values), lambda i: ("sphere", "within the tail")[i])


@BOTH
@pytest.mark.parametrize("theta", [0.0, 0.8, 1.6, 2.1])
def test_visible_normals_reach_the_tails(family, theta, generator, budget):
    """How many lie below 1e-2, …, 1e-5 of the peak: a sampler that cuts off 1e-4 of its normals fails."""
    distribution = build(family, (0.25,))
    w = direction(theta)
    share = shares(distribution, w)
    counts, n, block = torch.zeros_like(share), 1_000_000, 20_000
    for _ in range(n // block):
        m = distribution.sample_visible(w, torch.rand(block, 2, generator=generator, dtype=F64))
        counts += torch.bincount(cell_index(m, BINS), minlength=share.numel())
    levels = [1e-2, 1e-3, 1e-4, 1e-5]
    tails = [share < level * share.max() for level in levels]
    tests = [scipy.stats.binomtest(int(counts[t].sum()), n, float(share[t].sum())) for t in tails]
    budget(torch.tensor([test.pvalue for test in tests]), lambda i: f"below {levels[i]:g} of the peak")


BINS = (96, 32)


def shares(distribution: MicrofacetDistribution, w: Tensor) -> Tensor:
    """What each cell has of the visible normals, from smaller cells: a narrow lobe may graze a cell with its tip."""
    fine = sphere_cells(lambda m: distribution.D_visible(w, m), (2 * BINS[0], 3 * BINS[1]), 1e-7)
    assert float(fine.sum()) == pytest.approx(1, abs=1e-5)
    return fine.reshape(BINS[0], 2, BINS[1], 3).sum((1, 3)).reshape(-1)


def pearson(counts: Tensor, expected: Tensor) -> float:
    """p-value of chi²; cells that expect fewer than 5 are pooled."""
    order = torch.argsort(expected)
    counts, expected = counts[order].double(), expected[order].double()
    # Pools of at least 5, from the sparsest cells up.
    pool = torch.div(expected.cumsum(0), 5, rounding_mode="floor").long().clamp_max(int(expected.sum() / 5) - 1)
    _, pool = torch.unique(pool, return_inverse=True)
    size = int(pool.max()) + 1
    counts = torch.zeros(size, dtype=F64).index_add_(0, pool, counts)
    expected = torch.zeros(size, dtype=F64).index_add_(0, pool, expected)
    keep = expected > 0
    statistic = ((counts - expected)[keep] ** 2 / expected[keep]).sum()
    return float(scipy.stats.chi2.sf(float(statistic), int(keep.sum()) - 1))


@BOTH
@pytest.mark.parametrize("theta", [0.8, 2.1])
def test_float32_samples_have_their_density(family, theta, generator, budget):
    distribution = build(family, (0.4, 0.8), torch.float32)
    w = direction(theta, dtype=torch.float32)
    m = distribution.sample_visible(w, torch.rand(200_000, 2, generator=generator))
    exact = build(family, (0.4, 0.8))
    budget(torch.tensor([chi_square(m, lambda m: exact.D_visible(w.double(), m))]))


@BOTH
def test_a_batch_is_its_elements(family, generator):
    w = nn.functional.normalize(torch.randn(5, 1, 3, generator=generator, dtype=F64), dim=-1)
    u = torch.rand(7, 2, generator=generator, dtype=F64)
    alpha = torch.rand(5, 7, generator=generator, dtype=F64) + 0.1
    distribution = family(alpha, 0.3 * torch.ones((), dtype=F64))
    m = distribution.sample_visible(w, u)
    density = distribution.D_visible(w, m)
    assert m.shape == (5, 7, 3) and density.shape == (5, 7)
    for i, j in itertools.product(range(5), range(7)):
        single = build(family, (float(alpha[i, j]), 0.3))
        torch.testing.assert_close(single.sample_visible(w[i, 0], u[j]), m[i, j])
        torch.testing.assert_close(single.D_visible(w[i, 0], m[i, j]), density[i, j])


# Gradients.

EDGES = [0.0, 1e-3, 0.3, 1.2, math.pi / 2 - 1e-3, math.pi / 2 + 1e-3, 1.9, 2.6]


@BOTH
@pytest.mark.parametrize("alpha", [(0.5, 0.8), (0.05, 0.2), (1.0, 1.0)], ids=str)
@pytest.mark.parametrize("theta", EDGES)
def test_gradients(family, alpha, theta):
    w = direction(theta).requires_grad_()
    m = direction(0.4, 2.0).requires_grad_()
    ax, ay = (torch.tensor(a, dtype=F64, requires_grad=True) for a in alpha)
    u = torch.tensor([[0.3, 0.6], [0.01, 0.2], [0.99, 0.97], [0.9999, 0.5], [1e-4, 0.5]], dtype=F64)

    def check(f: Callable[..., Tensor], *x: Tensor) -> bool:
        return torch.autograd.gradcheck(f, x, eps=1e-7, atol=1e-4, rtol=1e-3)

    assert check(lambda m, ax, ay: family(ax, ay).D(m), m, ax, ay)
    assert check(lambda w, ax, ay: family(ax, ay).Lambda(w), w, ax, ay)
    assert check(lambda w, m, ax, ay: family(ax, ay).D_visible(w, m), w, m, ax, ay)
    assert check(lambda w, ax, ay: family(ax, ay).sample_visible(w, u), w, ax, ay)


@BOTH
def test_gradient_of_the_area_at_the_horizon(family):
    w = direction(math.pi / 2) * torch.tensor([1, 1, 0], dtype=F64)
    distribution = build(family, (0.5, 0.8))
    assert torch.autograd.gradcheck(lambda w: distribution.projected_area(split(w)), (w.requires_grad_(),))


THETAS = [0.0, 1e-9, 1e-5, 1e-3, 0.5, 1.5, 1.5699, math.radians(89.99), math.pi / 2, math.pi / 2 + 1e-8]
THETAS += [math.radians(90.01), 2.0, 3.0, math.pi - 1e-3, math.pi - 1e-9, math.pi]


@BOTH
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("alpha", [(1e-3,), (2.0,), (0.1, 1.0), (1e-3, 2.0)], ids=str)
def test_value_and_gradient_are_finite_everywhere(family, dtype, alpha):
    last = 1 - torch.finfo(dtype).eps / 2
    u = torch.tensor(list(itertools.product([0.0, 0.3, 0.5, last], repeat=2)), dtype=dtype)
    azimuths = (0.0, 0.7, math.pi / 2)
    w = torch.stack([direction(t, p, dtype) for t in THETAS for p in azimuths])[:, None]
    # Also the exact horizon and the exact pole.
    exact = torch.tensor([[0.6, 0.8, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], dtype=dtype)
    w = torch.cat([w, exact[:, None]])
    m = torch.cat([w[:, 0], exact])
    for name, inputs in {
        "D": lambda d, w, m, u: d.D(m),
        "Lambda": lambda d, w, m, u: d.Lambda(w),
        "D_visible": lambda d, w, m, u: d.D_visible(w, m),
        "sample_visible": lambda d, w, m, u: d.sample_visible(w, u),
        "D_visible of a sample": lambda d, w, m, u: d.D_visible(w, d.sample_visible(w, u)),
    }.items():
        # One α a row, so that a NaN is not hidden in a sum.
        alphas = [torch.full((len(w), 1), a, dtype=dtype, requires_grad=True) for a in alpha]
        leaves = [x.clone().requires_grad_() for x in (w, m, u)]
        value = inputs(family(*alphas), *leaves)
        assert value.isfinite().all(), name
        for gradient in torch.autograd.grad(value.sum(), alphas + leaves, allow_unused=True):
            assert gradient is None or gradient.isfinite().all(), name


# Parameters.


@BOTH
@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0, r"must lie in \[0.001, 2\]; got 0\. A mirror is the limit alpha -> 0"),
        (-0.5, r"got -0.5\."),
        (math.nan, r"got nan\."),
        (2.5, r"got 2.5\. .*nothing is rougher than 2"),
        (torch.tensor([[0.5, 0.5], [0.5, 0.0]]), r"got 0 at index \(1, 1\)\."),
    ],
)
@pytest.mark.parametrize("which", ["alpha", "alpha_y"])
def test_a_bad_alpha_is_named(family, which, value, told, messages):
    with pytest.raises(ValueError, match=rf"{family.__name__}\({which}=\.\.\.\) .*{told}"):
        family(**({"alpha": 0.5} | {which: value}))


@BOTH
@pytest.mark.parametrize("value", ["0.5", True, None, 1j])
def test_an_alpha_of_a_wrong_type(family, value, messages):
    with pytest.raises(TypeError):
        family(value)


@BOTH
def test_parameters_stay_parameters_and_maps_keep_their_graph(family):
    parameter = nn.Parameter(torch.tensor(0.4))
    assert dict(family(parameter).named_parameters()) == {"alpha": parameter}
    assert not list(family(0.4).parameters()) and set(family(0.4, 0.2).state_dict()) == {"alpha", "alpha_y"}
    logits = torch.zeros(4, 4, requires_grad=True)
    family(torch.sigmoid(logits)).Lambda(direction(0.5, dtype=torch.float32)).sum().backward()
    assert logits.grad is not None and (logits.grad != 0).all()


@BOTH
def test_a_block_of_a_map(family):
    alpha = torch.linspace(0.1, 1, 12)
    whole = family(alpha)
    part = with_parameters(whole, {"alpha": alpha[3:5]})
    w = direction(1.0, dtype=torch.float32)
    torch.testing.assert_close(part.Lambda(w), whole.Lambda(w)[3:5])


@BOTH
def test_repr_tells_the_numbers(family):
    assert "0.5" in repr(family(0.5))
