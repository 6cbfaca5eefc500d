"""The counter-based stream: the same numbers however they are asked for, uniform and independent of each other."""

import itertools
import subprocess
import sys
import textwrap

import pytest
import scipy.stats
import torch

from torchms import GGX, HeightWalk, Invariance, RoughConductor, RoughDielectric, Stream, Unidirectional
from torchms.fresnel import Conductor, Dielectric, Ideal

SEQUENCES = ("random", "sobol", "rank1")
GOLDEN = [
    [[12495685, 5895193], [14584804, 1156311]],
    [[15512517, 15340970], [912533, 6868430]],
    [[9650150, 15491933], [14346946, 13643669]],
]


def surface() -> RoughConductor:
    return RoughConductor(GGX(0.3, 0.5), Conductor([0.2, 0.9], [3.9, 2.5]), Unidirectional(Invariance(), 3))


def directions(rows: int, generator: torch.Generator) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(rows, 3, generator=generator), dim=-1).abs()


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_stands_for_its_numbers(sequence: str, generator: torch.Generator) -> None:
    """Every method gives with a stream what it gives with the stream's numbers, to the bit, over several blocks."""
    bsdf, rows = surface(), 9_001
    wi, wo = directions(rows, generator), directions(rows, generator)
    stream = Stream(7, 4, sequence)
    u = stream.uniforms((rows,), bsdf.n_uniforms)
    assert u.shape == (rows, 4, bsdf.n_uniforms) and float(u.min()) >= 0 and float(u.max()) < 1
    assert torch.equal(bsdf(wi, wo, stream), bsdf(wi, wo, u))
    assert torch.equal(bsdf.orders(wi, wo, stream), bsdf.orders(wi, wo, u))
    for method in (bsdf.sample, bsdf.sample_walk, bsdf.albedo):
        for with_stream, with_numbers in zip(method(wi, stream), method(wi, u), strict=True):
            assert torch.equal(with_stream, with_numbers)


def test_a_row_has_its_own_numbers(generator: torch.Generator) -> None:
    """Seeds of elements: any order, any part and any shape of the batch, more paths than a block, and broadcasting."""
    bsdf, rows = surface(), 9_000
    wi, wo = directions(rows, generator), directions(rows, generator)
    value = bsdf(wi, wo, Stream(7, 3))
    seeds = Stream(7, 3).seeds((rows,))
    order = torch.randperm(rows, generator=generator)
    assert torch.equal(bsdf(wi[order], wo[order], Stream(seeds[order], 3)), value[order])
    assert torch.equal(bsdf(wi[8_500:], wo[8_500:], Stream(seeds[8_500:], 3)), value[8_500:])
    shape = (90, 100)
    assert torch.equal(bsdf(wi.reshape(*shape, 3), wo.reshape(*shape, 3), Stream(7, 3)), value.reshape(*shape, -1))
    many = bsdf(wi[:2], wo[:2], Stream(7, 20_000))
    torch.testing.assert_close(many, bsdf(wi[:2], wo[:2], Stream(7, 20_000).uniforms((2,), bsdf.n_uniforms)))
    assert bsdf(wi[:1], wo[:5], Stream(torch.tensor(3))).shape == (5, 2)
    with pytest.raises(ValueError, match="broadcast"):
        bsdf(wi[:5], wo[:5], Stream(torch.arange(4)))


def test_double_has_the_same_numbers() -> None:
    assert torch.equal(Stream(3).uniforms((50,), 9).double(), Stream(3).uniforms((50,), 9, torch.float64))


def test_golden() -> None:
    """A changed number would change every exported file and every stored result."""
    u = Stream(torch.tensor([0, 7 << 32, -1]), 2).uniforms((3,), 2)
    assert (u * (1 << 24)).long().tolist() == GOLDEN


def test_uniform_and_independent(budget, seed: int) -> None:
    """chi² of single numbers, of their low bits, and of pairs: rows, paths, dimensions and seeds."""
    p = []

    def counts(cells: torch.Tensor, n: int) -> None:
        p.append(scipy.stats.chisquare(torch.bincount(cells.flatten(), minlength=n).numpy()).pvalue)

    def pair(a: torch.Tensor, b: torch.Tensor, m: int = 32) -> None:
        counts((a * m).long() * m + (b * m).long(), m * m)

    rows, D = 1 << 17, 8
    for start in (0, 1, seed % 2**31):
        u = Stream(start).uniforms((rows,), D)[:, 0]
        v = Stream(start + 1 if start + 1 < 2**31 else 5).uniforms((rows,), D)[:, 0]
        for d in range(D):
            counts((u[:, d] * 1024).long(), 1024)
            counts((u[:, d] * (1 << 24)).long() & 1023, 1024)
            pair(u[:, d], v[:, d])
            for lag in (1, 2, 8192):
                pair(u[:-lag, d], u[lag:, d])
        for d, e in itertools.combinations(range(D), 2):
            pair(u[:, d], u[:, e])
    paths = Stream(3, 2048).uniforms((64,), D)
    for d in range(D):
        pair(paths[:, :-1, d], paths[:, 1:, d])
        pair(paths[:-1, :, d], paths[1:, :, d])
    strided = Stream(torch.arange(rows) * (1 << 40)).uniforms((rows,), 2)[:, 0]
    pair(strided[:-1, 0], strided[1:, 0])
    pair(strided[:, 0], strided[:, 1])
    budget(torch.tensor(p))


@pytest.mark.parametrize("sequence", ["sobol", "rank1"])
def test_sets_are_unbiased_and_better(sequence: str, budget) -> None:
    """Over rotations the mean is right, and its variance is a small part of that of independent numbers."""
    rows, n_paths = 20_000, 64

    def means(kind: str) -> torch.Tensor:
        u = Stream(5, n_paths, kind).uniforms((rows,), 3, torch.float64)
        return (1 + (u - 0.5)).prod(-1).mean(1)

    x = means(sequence)
    z = (x.mean() - 1) / (x.std() / rows**0.5)
    budget(2 * torch.distributions.Normal(0.0, 1.0).cdf(-z.abs()))
    assert float(x.var()) < 0.1 * float(means("random").var())


@pytest.mark.slow
@pytest.mark.parametrize("glass", [False, True], ids=["mirror", "glass"])
def test_no_bias_in_the_furnace(glass: bool, generator: torch.Generator, budget) -> None:
    """1e8 numbers: each order's energy agrees with that of torch's own generator."""
    bsdf = (
        RoughDielectric(GGX(0.8), Dielectric(1.5), HeightWalk(3), "importance")
        if glass
        else RoughConductor(GGX(0.8), Ideal(), HeightWalk(3))
    )
    rows, n_paths = 400, 100_000_000 // (400 * bsdf.n_uniforms)
    wi = torch.tensor([0.8, 0.0, 0.6]).expand(rows, 3)
    energies = []
    for u in (Stream(1, n_paths), bsdf.uniforms((rows,), n_paths, generator=generator)):
        albedo = bsdf.albedo(wi, u)
        energies.append(torch.cat([albedo.reflected, albedo.transmitted], -2).double())
    a, b = energies
    error = ((a.var(0) + b.var(0)) / rows).sqrt()
    used = error > 1e-12
    z = ((a.mean(0) - b.mean(0)) / error)[used]
    budget(2 * torch.distributions.Normal(0.0, 1.0).cdf(-z.abs().double()))


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize(
    "arguments,kind,words",
    [
        ((-1,), ValueError, ["seed", "[0, 2^31)", "-1"]),
        ((2**31,), ValueError, ["seed", "int64"]),
        ((0.5,), TypeError, ["seed", "float"]),
        ((torch.zeros(3),), TypeError, ["seed", "float32"]),
        ((0, 0), ValueError, ["n_paths", "got 0"]),
        ((0, 1.0), TypeError, ["n_paths", "float"]),
        ((0, 1, "halton"), ValueError, ["sequence", "'halton'", "sobol"]),
    ],
)
def test_arguments_that_do_not_fit(arguments: tuple, kind: type, words: list[str]) -> None:
    with pytest.raises(kind) as caught:
        Stream(*arguments)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.slow
def test_numbers_compile():
    """In a user's own `torch.compile`, whose Inductor takes integers under a stack of floats for floats: the same bits."""
    program = """
        import torch
        from torchms import Stream
        from torchms.bsdfs import compile as compiled
        numbers = lambda: Stream(5, 2).uniforms((30,), 4)
        fast = torch.compile(numbers, fullgraph=True, options=compiled.OPTIONS)
        assert torch.equal(fast(), numbers())
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=200, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
