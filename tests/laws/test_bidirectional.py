"""Joining two walks is the same sum as following one: order by order, in energy, in symmetry and in gradient."""

import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from cases import (
    DISTRIBUTIONS,
    ELLIPTIC,
    LOSSLESS,
    MATERIALS,
    ONE_OF_EACH,
    SEGMENTS,
    direction,
    directions,
    each,
    transmits,
)
from torch import Tensor

from torchms import (
    BSDF,
    GGX,
    Bidirectional,
    Correlated,
    HeightWalk,
    Invariance,
    Scattering,
    SingleBounce,
    Unidirectional,
)
from torchms.estimators.bidirectional import Drawn, own_numbers
from torchms.lobes import measure
from torchms.sampling.stream import Stream
from torchms.testing import Estimate, estimate, p_value, zscore

PAIRS = 24
LEAST_COS = 0.2
"""Nearer to the horizon a walk from one side meets its rare connections too seldom for a z-test."""
RESOLVED = 0.1
"""Relative standard error up to which a number is compared: the mean of rarer events is not normal."""
ROUNDING = 1e-9
HALF_CELL = (0.12, 0.4)
"""A pair's cell: cos θ_o and φ_o up to so far on either side of wo."""

ALPHAS = {"0.25": (0.25,), "0.5": (0.5,), "1": (1.0,), "1,0.1": (1.0, 0.1)}
MODELS = [
    (material, segment)
    for material in ONE_OF_EACH
    for segment in SEGMENTS
    if SEGMENTS[segment].transmits or not transmits(material)
]
ENERGY = json.loads((Path(__file__).parents[1] / "golden" / "heitz_energy.json").read_text())["rows"]


def surface(
    material: str, scattering: Scattering, distribution: str = "ggx", alpha: tuple[float, ...] = (0.7, 0.3)
) -> BSDF:
    """The BSDF of these names in float64."""
    return MATERIALS[material](DISTRIBUTIONS[distribution](*alpha), scattering).to(torch.float64)


def pairs(material: str, generator: torch.Generator, distribution: str = "ggx") -> tuple[Tensor, Tensor]:
    """`PAIRS` of directions, from every side that the material serves to every other; a third for costly GTR."""
    w = directions(2 * PAIRS, generator, LEAST_COS)
    if transmits(material):
        w = w * torch.where(torch.rand(2 * PAIRS, 1, generator=generator) < 0.5, -1.0, 1.0)
    few = PAIRS // 3 if distribution == "gtr" else PAIRS
    return w[:few], w[-few:]


def values(bsdf: BSDF, wi: Tensor, wo: Tensor, seed: int, n: int) -> Estimate:
    """Estimates (pairs, K, C) of `orders` by `n` paths each."""
    u = Stream(torch.arange(len(wi) * n).reshape(-1, n) + ((seed % 2**20) << 32))
    return estimate(bsdf.orders(wi[:, None], wo[:, None], u), 1)


def agreement(a: Estimate, b: Estimate) -> tuple[Tensor, Tensor]:
    """p-values of the numbers that both have resolved, and which they are."""
    resolved = (a.stderr < RESOLVED * a.mean) & (b.stderr < RESOLVED * b.mean)
    return p_value(zscore(a, b, ROUNDING * a.mean))[resolved], resolved


def compared(a: Estimate, b: Estimate) -> tuple[Tensor, list[list[int]]]:
    """The p-values of `agreement` with their indices; most of the light is among what is compared."""
    p, resolved = agreement(a, b)
    assert a.mean[resolved].sum() > 0.7 * a.mean.sum()
    return p, resolved.nonzero().tolist()


def matrix(default: tuple[str, ...], n_default: int, n_slow: int, least: float = 0.0) -> pytest.MarkDecorator:
    """Parametrize over distribution × α × size: the `default` α small, and, slow, all large; a third for costly GTR.

    least: least roughness along any axis.
    """
    cases = [pytest.param("ggx", ALPHAS[a], n_default, id=f"ggx-{a}-{n_default}") for a in default]
    for d, a in itertools.product(DISTRIBUTIONS, [a for a, alpha in ALPHAS.items() if min(alpha) >= least]):
        n = n_slow // 3 if d == "gtr" else n_slow
        cases.append(pytest.param(d, ALPHAS[a], n, id=f"{d}-{a}-{n}", marks=pytest.mark.slow))
    return pytest.mark.parametrize("distribution,alpha,n", cases)


def around(wo: Tensor, n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Directions (pairs, n, 3), uniform over the cell of each wo, and the cells' solid angles."""
    low, high = (wo[:, 2].abs() - HALF_CELL[0]).clamp_min(0.05), (wo[:, 2].abs() + HALF_CELL[0]).clamp_max(1)
    u = torch.rand(2, len(wo), n, generator=generator, dtype=wo.dtype)
    z = low[:, None] + (high - low)[:, None] * u[0]
    phi = torch.atan2(wo[:, 1], wo[:, 0])[:, None] + HALF_CELL[1] * (2 * u[1] - 1)
    r = (1 - z * z).clamp_min(0).sqrt()
    up = wo[:, 2].sign()[:, None]
    return torch.stack([r * phi.cos(), r * phi.sin(), z * up], -1), (high - low) * 2 * HALF_CELL[1]


def lands(d: Tensor, wo: Tensor) -> Tensor:
    """Whether each d (pairs, n, 3) lies in the cell of its wo."""
    low, high = (wo[:, 2].abs() - HALF_CELL[0]).clamp_min(0.05), (wo[:, 2].abs() + HALF_CELL[0]).clamp_max(1)
    z = d[..., 2] * wo[:, 2].sign()[:, None]
    turn = torch.atan2(d[..., 1], d[..., 0]) - torch.atan2(wo[:, 1], wo[:, 0])[:, None]
    turn = (turn + math.pi) % (2 * math.pi) - math.pi
    return (z >= low[:, None]) & (z < high[:, None]) & (turn.abs() < HALF_CELL[1])


def walked(bsdf: BSDF, wi: Tensor, wo: Tensor, seed: int, n: int) -> Estimate:
    """Share of the energy from wi that its walks carry into the cell of wo, by order: (pairs, K, C)."""
    total = square = torch.zeros((), dtype=torch.float64)
    size = 20_000
    for block in range(n // size):
        walks = bsdf.sample_walk(wi, Stream(seed + block, size))
        there = (walks.order[..., None] == torch.arange(1, bsdf.max_order + 1)) & lands(walks.wo, wo)[..., None]
        total = total + torch.einsum("pnk,pnc->pkc", there.double(), walks.weight)
        square = square + torch.einsum("pnk,pnc->pkc", there.double(), walks.weight**2)
    mean = total / n
    return Estimate(mean, ((square / n - mean**2) / n).clamp_min(0).sqrt(), n)


@pytest.mark.parametrize("material,segment", MODELS, ids=["-".join(pair) for pair in MODELS])
@matrix(("0.5", "1,0.1"), 40_000, 60_000)
def test_walks_go_where_it_says(material, segment, distribution, alpha, n, generator, seed, budget):
    """Orders 1 … 4 over a small cell about each of 24 random wo: the walk of the same model, and the height walk.

    A walk that ends in a cell is counted, so no rare connection can hide, whatever the roughness. GTR has eight cells.
    """
    wi, wo = pairs(material, generator, distribution)
    K, model = 4, SEGMENTS[segment]
    joined = surface(material, Bidirectional(model(), K), distribution, alpha)
    if distribution == "gtr":  # few cells: where the light goes
        wo = joined.sample(wi, joined.uniforms((len(wi),), 1, generator=generator))[0][:, 0]
    there, solid_angle = around(wo, 3 * n // (5 * len(wo)), generator)
    ours = estimate(joined.orders(wi[:, None], there, Stream(seed % 2**31)), 1)
    ours = Estimate(ours.mean * solid_angle[:, None, None], ours.stderr * solid_angle[:, None, None], ours.n)
    p, where = [], []
    for other in [Unidirectional(model(), K)] + ([HeightWalk(K)] if segment == "invariance" else []):
        part, index = compared(ours, walked(surface(material, other, distribution, alpha), wi, wo, seed % 2**30, n))
        p.append(part)
        where += [(type(other).__name__, *i) for i in index]
    budget(torch.cat(p), lambda i: where[i])


@pytest.mark.parametrize("material,segment", MODELS, ids=["-".join(pair) for pair in MODELS])
@matrix(("1",), 4_000, 10_000, least=0.5)
def test_values_are_those_of_the_walk_from_one_side(material, segment, distribution, alpha, n, generator, seed, budget):
    """Orders 1 … 4, at 24 pairs of directions (GTR: 8); with `Invariance` the height walk's, too.

    Connections to a narrow lobe are too rare for a z-test: there walks are compared.
    """
    wi, wo = pairs(material, generator, distribution)
    K, model = 4, SEGMENTS[segment]
    joined = values(surface(material, Bidirectional(model(), K), distribution, alpha), wi, wo, seed % 2**20, n // 2)
    p, where = [], []
    for i, other in enumerate([Unidirectional(model(), K)] + ([HeightWalk(K)] if segment == "invariance" else [])):
        theirs = values(surface(material, other, distribution, alpha), wi, wo, (seed + 1 + i) % 2**20, 2 * n)
        part, index = compared(joined, theirs)
        p.append(part)
        where += [(type(other).__name__, *j) for j in index]
    budget(torch.cat(p), lambda i: where[i])


@pytest.mark.parametrize("material", [m for m in LOSSLESS if m != "dielectric"])
@each("distribution", ELLIPTIC)
@pytest.mark.parametrize("n", [2_000, pytest.param(50_000, marks=pytest.mark.slow)])
def test_energies_are_those_of_the_reference(material, distribution, n, generator, seed, budget):
    """∫ orders dwo = the share that the independent height walks of tests/golden count."""
    p, where = [], []
    for row in ENERGY:
        if (row["material"], row["distribution"]) != (material, distribution):
            continue
        bsdf = surface(LOSSLESS[material], Bidirectional(SEGMENTS["invariance"](), 5), distribution, row["alpha"])
        wi = direction(row["theta_i"], 0.0)
        wo, pdf = bsdf.sample(wi, bsdf.uniforms((), n, generator=generator))
        ours = estimate(bsdf.orders(wi, wo, Stream(seed % 2**31)) / pdf[:, None, None])
        share = torch.tensor(row["R"][:5], dtype=torch.float64)[:, None]
        theirs = Estimate(share, (share * (1 - share) / row["n"]).sqrt(), row["n"])
        part, resolved = agreement(ours, theirs)
        p.append(part)
        where += [(row["alpha"], row["theta_i"], *index) for index in resolved.nonzero().tolist()]
    budget(torch.cat(p), lambda i: where[i])


@each("segment", [s for s in SEGMENTS if SEGMENTS[s].transmits])
@each("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_energies_of_glass_are_those_of_its_walk(segment, distribution, side, generator, seed, budget):
    """Each order, reflected and transmitted, lit from either side."""
    wi = side * direction(0.9)
    model = SEGMENTS[segment]
    bsdf = surface("dielectric", Bidirectional(model(), 4), distribution)
    tally = measure(
        surface("dielectric", Unidirectional(model(), 4), distribution), wi, n_paths=100_000, seed=seed, progress=False
    )
    wo, pdf = bsdf.sample(wi, bsdf.uniforms((), 20_000, generator=generator))
    energy = bsdf.orders(wi, wo, Stream(seed % 2**31)) / pdf[:, None, None]
    reflected = (wo[:, 2] * side > 0)[:, None, None]
    ours = estimate(torch.stack([energy * reflected, energy * ~reflected], 1))
    theirs = Estimate(
        torch.stack([tally.reflected, tally.transmitted]),
        torch.stack([tally.reflected_stderr, tally.transmitted_stderr]),
        tally.n,
    )
    p, resolved = agreement(ours, theirs)
    assert ours.mean[resolved].sum() > 0.9
    budget(p, lambda i: resolved.nonzero()[i].tolist())


SMOOTH = [(material, segment) for material, segment in MODELS if material != "diffuse" and segment != "uncorrelated"]


@pytest.mark.parametrize("material,segment", SMOOTH, ids=["-".join(pair) for pair in SMOOTH])
def test_order_one_is_the_single_bounce(material, segment, generator):
    """To rounding, for smooth facets and the models whose order 1 is G2; the diffuse facet is drawn."""
    wi, wo = pairs(material, generator)
    single = surface(material, SingleBounce())(wi, wo)
    for K in (1, 3):
        bsdf = surface(material, Bidirectional(SEGMENTS[segment](), K))
        first = bsdf.orders(wi, wo, bsdf.uniforms((PAIRS,), 2, generator=generator))[:, 0]
        torch.testing.assert_close(first, single, rtol=1e-12, atol=0)


def swapped(u: Tensor, lengths: tuple[int, ...], n: int) -> Tensor:
    """`u` with the numbers of the walk from wi and of the walk from wo exchanged, pair by pair."""
    parts, first = [u[..., :1]], 1
    for pair, length in enumerate(lengths):
        half = own_numbers(pair, length, n)
        parts += [u[..., first + half : first + 2 * half], u[..., first : first + half]]
        first += 2 * half
    return torch.cat([*parts, u[..., first:]], -1)


@pytest.mark.parametrize("material,segment", MODELS, ids=["-".join(pair) for pair in MODELS])
@each("distribution", DISTRIBUTIONS)
def test_reciprocity_is_exact_with_the_walks_exchanged(material, segment, distribution, generator):
    """n_i² f(wi, wo) = n_o² f(wo, wi), path by path and not only in expectation, where the model is reciprocal."""
    bsdf = surface(material, Bidirectional(SEGMENTS[segment](), 5), distribution)
    wi, wo = pairs(material, generator)
    u = bsdf.uniforms((PAIRS,), 1, generator=generator)
    v = swapped(u, bsdf.scattering.lengths, bsdf.vertex.n_uniforms)
    there = bsdf.orders(wi, wo, u) / wo[:, 2].abs()[:, None, None]
    back = bsdf.orders(wo, wi, v) / wi[:, 2].abs()[:, None, None]
    if transmits(material):
        n2_i, n2_o = (torch.where(w[:, 2] < 0, 1.5**2, 1.0)[:, None, None] for w in (wi, wo))
        there, back = there * n2_i, back * n2_o
    if bsdf.scattering.is_reciprocal:
        torch.testing.assert_close(there, back, rtol=1e-9, atol=1e-13)
    else:
        assert (there - back)[:, 1:].abs().max() > 1e-3 * there.abs().max()


class Watched(list[Tensor]):
    """Random numbers that remember which of them were asked for."""

    def __init__(self, numbers: Sequence[Tensor]) -> None:
        super().__init__(numbers)
        self.asked: list[int] = []

    def __getitem__(self, k):
        self.asked.append(k)
        return super().__getitem__(k)


@pytest.mark.parametrize("n", [2, 4])
@pytest.mark.parametrize("K", [1, 2, 6])
def test_facets_met_first_are_spread(n, K, generator):
    """Every number but the first of all is drawn by one walk alone, but those of the first facets, which four pairs share:
    a quarter of them falls into each quarter of either number, and a number is as likely as any other in every pair."""
    lengths = Bidirectional(Invariance(), K).lengths
    D = 1 + 2 * sum(own_numbers(i, length, n) for i, length in enumerate(lengths))
    u = Watched(torch.rand(D, 4096, generator=generator, dtype=torch.float64).unbind(0))
    first, pairs, met = 1, [], []
    for pair in range(len(lengths)):
        pairs.append(Drawn(u, pair, first, lengths, n))
        first += 2 * pairs[pair].side
    u.asked.clear()  # the types' run-time checks look at some
    for drawn, length in zip(pairs, lengths, strict=True):
        for against in (False, True):
            numbers = [drawn.of(against, bounce, range(n)) for bounce in range(length)]
            assert all(len(some) == n for some in numbers)
            met += [] if against else [torch.stack(numbers[0][:2])]
    counts = [u.asked.count(k) for k in range(D)]
    shared = {1, 2, 1 + lengths[0] * n, 2 + lengths[0] * n}
    assert first == D and counts == [0, *(len(lengths) if k in shared else 1 for k in range(1, D))]
    assert all(bool(((x >= 0) & (x < 1)).all()) for x in met)
    if K > 1:
        quarters = (torch.stack(met) * 4).floor().sort(0).values
        assert torch.equal(quarters, torch.arange(4.0, dtype=torch.float64)[:, None, None].expand_as(quarters))


@pytest.mark.parametrize("alpha", [0.25, 0.5, 1.0])
def test_variance_of_one_path(alpha, generator, seed):
    """Geometric mean over 24 pairs, F = 1, K = 10: a tenth of the height walk's, a third of the walk's from one side.

    What `benchmarks/variance.py` measures with more paths.
    """
    wi, wo = directions(PAIRS, generator, 0.0), directions(PAIRS, generator, 0.0)
    variance = {}
    for scattering, n in (
        (Bidirectional(SEGMENTS["invariance"](), 10), 1_500),
        (Unidirectional(SEGMENTS["invariance"](), 10), 10_000),
        (HeightWalk(10), 10_000),
    ):
        bsdf = MATERIALS["conductor[ideal]"](GGX(alpha), scattering)
        u = Stream(torch.arange(PAIRS * n).reshape(PAIRS, n) + ((seed % 2**20) << 32))
        variance[type(scattering)] = bsdf(wi.float()[:, None], wo.float()[:, None], u).double().var(1)

    def mean_ratio(other: type) -> float:
        return float((variance[Bidirectional] / variance[other]).log().mean().exp())

    assert mean_ratio(HeightWalk) < 0.10
    assert mean_ratio(Unidirectional) < 0.35


@pytest.mark.parametrize("material,segment", MODELS, ids=["-".join(pair) for pair in MODELS])
def test_gradient_is_that_of_finite_differences(material, segment, generator):
    """In α_x, α_y and both directions, with the same random numbers: the gradient of attached directions.

    Glass with one bounce only: the choice to refract carries a gradient that no fixed numbers show.
    """
    max_order = 1 if transmits(material) else 3
    wi, wo = (w[:2] for w in pairs(material, generator))
    bsdf = surface(material, Bidirectional(SEGMENTS[segment](), max_order))
    u = bsdf.uniforms((2,), 1, generator=generator)

    def f(ax: Tensor, ay: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        wi, wo = (torch.nn.functional.normalize(w, dim=-1) for w in (wi, wo))
        model = MATERIALS[material](GGX(ax, ay), Bidirectional(SEGMENTS[segment](), max_order, attached=True))
        return model.to(torch.float64)(wi, wo, u)

    alphas = torch.tensor([0.6, 0.35], dtype=torch.float64)
    inputs = [x.clone().requires_grad_() for x in (alphas[0], alphas[1], wi, wo)]
    torch.autograd.gradcheck(f, inputs, eps=1e-7, atol=1e-5, rtol=1e-4, fast_mode=True)


@pytest.mark.parametrize("material,segment", MODELS, ids=["-".join(pair) for pair in MODELS])
@each("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_value_and_gradient_are_finite_at_the_edges(material, segment, distribution, dtype, generator):
    """The pole, the horizon and below it, wi = wo and wi opposite to wo, random numbers of 0 and just below 1."""
    edges = torch.stack(
        [
            direction(t, phi)
            for t, phi in ((0, 0), (math.pi / 2, 0.3), (math.pi / 2 - 1e-4, 2.0), (2.0, 1.0), (math.pi, 0), (0.8, 0.7))
        ]
    ).to(dtype)
    edges[1, 2] = 0
    wi, wo = edges[:, None].expand(-1, 6, 3).reshape(-1, 3), edges[None].expand(6, -1, 3).reshape(-1, 3)
    for number in (0.0, 1 - torch.finfo(dtype).eps / 2, 0.37):
        alphas = [torch.tensor(a, dtype=dtype, requires_grad=True) for a in (0.7, 0.3)]
        facets = DISTRIBUTIONS[distribution](*alphas)
        bsdf = MATERIALS[material](facets, Bidirectional(SEGMENTS[segment](), 4)).to(dtype)
        a, b = wi.clone().requires_grad_(), wo.clone().requires_grad_()
        u = torch.full((36, 1, bsdf.n_uniforms), number, dtype=dtype)
        value = bsdf.orders(a, b, u)
        assert torch.isfinite(value).all() and (value >= 0).all()
        value.sum().backward()
        for x in (a, b, *alphas):
            assert x.grad is not None and torch.isfinite(x.grad).all()
        dark = (wi[:, 2] == 0) | (wo[:, 2] == 0) if transmits(material) else (wi[:, 2] <= 0) | (wo[:, 2] <= 0)
        assert (value[dark] == 0).all()


@pytest.mark.usefixtures("messages")
def test_only_closed_segment_terms_can_be_joined():
    with pytest.raises(TypeError, match=r"Bidirectional\(segment=...\) must be Uncorrelated"):
        Bidirectional(HeightWalk(2))
    assert Bidirectional(HeightWalk(2).segment).is_unbiased
    with pytest.raises(ValueError, match="holds on one side"):
        MATERIALS["dielectric"](GGX(0.5), Bidirectional(SEGMENTS["invariance"](), 2))
    assert not Bidirectional(Correlated()).is_reciprocal
