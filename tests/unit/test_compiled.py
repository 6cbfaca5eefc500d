"""`torchms.compile`: another way to run the same functions."""

import copy
import pickle

import pytest
import torch
from torch import nn

import torchms
from torchms import (
    GGX,
    GTR,
    Beckmann,
    Bidirectional,
    Invariance,
    RoughConductor,
    RoughDielectric,
    SingleBounce,
    Stream,
    Unidirectional,
)
from torchms.approximations import AlbedoTable
from torchms.bsdfs import compile as compiled
from torchms.evaluation import engine, run
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.machine.record import Recorder, UnknownOperation, record

SMALL = 64
CLOSE = {"rtol": 2e-4, "atol": 2e-6}
"""Rounding grows along a path; see benchmarks/speed.py for its distribution."""


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts for a thread so small that batches need several of them."""
    if compiled._missing_compiler():
        pytest.skip("torchms.compile needs a C++ compiler")
    monkeypatch.setattr(engine, "_programs", {})
    for name in ("PIECE", "ELEMENTS", "PATHS"):
        monkeypatch.setattr(run, name, SMALL)


def directions(rows: int, generator: torch.Generator) -> torch.Tensor:
    w = torch.nn.functional.normalize(torch.randn(rows, 3, generator=generator), dim=-1)
    return torch.stack([w[:, 0], w[:, 1], w[:, 2].abs()], -1)


def same(actual, expected) -> None:
    for a, b in zip(actual, expected, strict=True):
        assert a.shape == b.shape and a.dtype == b.dtype
        torch.testing.assert_close(a, b, **CLOSE)


def test_every_method(generator: torch.Generator, capfd: pytest.CaptureFixture[str]) -> None:
    """Values of every method on more rows than a block, on fewer, on none and without a batch axis, from one code."""
    eager = RoughConductor(GGX(0.4, 0.7), Conductor.metal("Au"), Unidirectional(Invariance(), 2))
    fast = torchms.compile(eager)
    assert isinstance(fast, RoughConductor) and fast.n_uniforms == eager.n_uniforms
    wi, wo, stream = directions(100, generator), directions(100, generator), Stream(5, 3)
    for rows in (slice(0, 100), slice(0, 3), slice(0, 1), slice(0, 0)):
        same([fast(wi[rows], wo[rows], stream)], [eager(wi[rows], wo[rows], stream)])
        same([fast.pdf(wi[rows], wo[rows])], [eager.pdf(wi[rows], wo[rows])])
    same([fast(wi[0], wo[0], stream)], [eager(wi[0], wo[0], stream)])
    same([fast(wi.reshape(4, 25, 3), wo[:25], stream)], [eager(wi.reshape(4, 25, 3), wo[:25], stream)])
    # More paths than a block holds.
    same([fast(wi[:2], wo[:2], Stream(5, 100))], [eager(wi[:2], wo[:2], Stream(5, 100))])
    same([fast.orders(wi, wo, stream)], [eager.orders(wi, wo, stream)])
    same(fast.sample(wi, stream), eager.sample(wi, stream))
    same(fast.albedo(wi, stream), eager.albedo(wi, stream))
    # Component-contiguous input is the same input.
    same([fast(wi.T.contiguous().T, wo.T.contiguous().T, stream)], [eager(wi, wo, stream)])
    assert len(fast.engine.compiled) == 5, "forward, pdf, orders, sample and albedo: one code each, whatever the batch"
    assert capfd.readouterr().err.count("forward of RoughConductor") == 1


@pytest.mark.slow
def test_numbers_from_elsewhere(generator: torch.Generator) -> None:
    """A tensor of random numbers, a shared Sobol set and seeds of one's own."""
    eager = RoughConductor(GGX(0.5), Conductor(0.2, 3.0), Unidirectional(Invariance(), 2))
    fast = torchms.compile(eager, verbose=False)
    wi, wo = directions(70, generator), directions(70, generator)
    for u in (eager.uniforms((70,), 2, generator=generator), Stream(1, 4, "sobol"), Stream(torch.arange(70) * 977, 2)):
        same([fast(wi, wo, u)], [eager(wi, wo, u)])


@pytest.mark.slow
def test_walk_of_glass(generator: torch.Generator) -> None:
    """Discrete choices fall as they do in eager mode, save where rounding decides them."""
    eager = RoughDielectric(GGX(0.5), Dielectric(1.5), Unidirectional(torchms.Correlated(), 2))
    fast = torchms.compile(eager, verbose=False)
    wi = directions(500, generator)
    a, b = fast.sample_walk(wi, Stream(2)), eager.sample_walk(wi, Stream(2))
    agree = (a.order == b.order) & ((a.wo - b.wo).abs().amax(-1) < 1e-3)
    assert float(agree.float().mean()) > 0.99
    torch.testing.assert_close(a.weight[agree], b.weight[agree], **CLOSE)


def test_gradients_of_maps_and_parameters(generator: torch.Generator) -> None:
    """Per-pixel maps with channels, an nn.Parameter and the directions, through the compiled backward."""
    alpha, f0 = nn.Parameter(torch.tensor(0.5)), torch.rand(70, 3, generator=generator).requires_grad_()
    eager = RoughConductor(GGX(alpha), Schlick(f0), Unidirectional(Invariance(), 2))
    fast = torchms.compile(eager, verbose=False)
    assert fast.distribution.alpha is alpha, "parameters are shared, so an optimizer of either serves both"
    wi, wo = directions(70, generator).requires_grad_(), directions(70, generator)
    gradients = []
    for surface in (fast, eager):
        value = surface(wi, wo, Stream(3, 2))
        gradients.append(torch.autograd.grad(value.square().sum(), (alpha, f0, wi)))
    for a, b in zip(*gradients, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4 * float(b.abs().max()))


@pytest.mark.slow
def test_bidirectional(generator: torch.Generator) -> None:
    """The estimator with the largest code."""
    eager = RoughConductor(GGX(0.5), Conductor.metal("Cu"), Bidirectional(Invariance(), 4))
    fast = torchms.compile(eager, verbose=False)
    wi, wo = directions(70, generator), directions(70, generator)
    same([fast(wi, wo, Stream(1, 2))], [eager(wi, wo, Stream(1, 2))])


def test_copies_compile_for_themselves() -> None:
    """A compiled BSDF is copied and pickled like any other; machine code stays where it was made."""
    fast = torchms.compile(RoughConductor(GGX(0.5), Conductor(0.2, 3.0)), verbose=False)
    for other in (copy.deepcopy(fast), pickle.loads(pickle.dumps(fast))):
        assert other.engine is not fast.engine and not other.engine.compiled
        assert other.distribution.alpha is not fast.distribution.alpha
        assert other.state_dict().keys() == fast.state_dict().keys()


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch, generator: torch.Generator) -> None:
    """One warning that says what is missing; the result works, in blocks."""
    eager = RoughConductor(GGX(0.5), Conductor(0.2, 3.0))
    monkeypatch.setattr(compiled, "_missing_compiler", lambda: "no g++")
    with pytest.warns(RuntimeWarning, match=r"no working C\+\+ compiler \(no g\+\+\).*Install"):
        fast = torchms.compile(eager)
    wi = directions(5, generator)
    assert torch.equal(fast(wi, wi, Stream(1)), eager(wi, wi, Stream(1)))


def test_built_anew_in_every_step(generator: torch.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Around maps that a network gives: compiled once, and the gradient reaches the network."""
    counted = []
    compile_one = compiled.Engine._compile
    monkeypatch.setattr(compiled.Engine, "_compile", lambda *a: counted.append(0) or compile_one(*a))
    network, wi = nn.Linear(4, 1), directions(70, generator)
    features = torch.randn(70, 4, generator=generator)
    steps = []
    for scale in (0.3, 0.6):
        alpha = scale * torch.sigmoid(network(features)).squeeze(-1) + 0.1
        eager = RoughConductor(GGX(alpha), Schlick([0.3, 0.9]), SingleBounce())
        fast = torchms.compile(eager, verbose=False)
        gradients = [torch.autograd.grad(b(wi, wi).sum(), network.weight, retain_graph=True) for b in (fast, eager)]
        same(gradients[0], gradients[1])
        steps.append(gradients[0][0])
    assert not torch.equal(*steps) and len(counted) == 1
    # The one has two tables, the other has one: a code for each.
    halved = AlbedoTable.packaged("GGX")
    halved.c_round.mul_(0.5)
    tables = [torchms.KullaConty(), torchms.KullaConty(halved)]
    both = [RoughConductor(GGX(0.7), Schlick([0.9]), table) for table in tables]
    same([torchms.compile(b, verbose=False)(wi, wi) for b in both], [b(wi, wi) for b in both])
    assert len(counted) == 3 and not torch.equal(both[0](wi, wi), both[1](wi, wi))


def test_exchanged_parts_compile_anew(generator: torch.Generator) -> None:
    """Another distribution, Fresnel term or scattering put into a compiled BSDF; numbers alone change no code."""
    fast = torchms.compile(RoughConductor(GGX(0.5), Conductor(0.2, 3.0)), verbose=False)
    wi = directions(5, generator)
    fast.pdf(wi, wi)
    fast.distribution.get_buffer("alpha").fill_(0.6)
    fast.eval()
    same([fast.pdf(wi, wi)], [RoughConductor(GGX(0.6), Conductor(0.2, 3.0)).pdf(wi, wi)])
    assert len(fast.engine.compiled) == 1
    fast.distribution = Beckmann(0.5)
    same([fast.pdf(wi, wi)], [RoughConductor(Beckmann(0.5), Conductor(0.2, 3.0)).pdf(wi, wi)])
    fast.fresnel = Schlick([0.2])
    fast.scattering = SingleBounce()
    same([fast(wi, wi)], [RoughConductor(Beckmann(0.5), Schlick([0.2]), SingleBounce())(wi, wi)])


def test_takes_a_bsdf_only(messages: None) -> None:
    with pytest.raises(TypeError, match=r"takes a BSDF .* got GGX"):
        torchms.compile(GGX(0.5))


def test_a_surface_with_a_spline(generator):
    """GTR with one α and one γ: eager, a spline looked up by the angle; no program can look up by a number."""
    wi, wo = directions(100, generator), directions(100, generator)
    for alpha, gamma in ((0.7, 1.6), (0.2, 1.1)):
        surface = RoughConductor(GTR(alpha, gamma), Schlick([0.9, 0.5]), SingleBounce())
        fast = torchms.compile(surface, verbose=False)
        torch.testing.assert_close(fast(wi, wo), surface(wi, wo), **CLOSE)


def test_a_look_up_by_a_number_is_refused():
    """Not written down with the place that it had while it was recorded."""

    def looked_up(recorder: Recorder) -> list[torch.Tensor]:
        table, x = recorder.shared(torch.arange(4.0)), recorder.column(torch.float32)
        return [table[(3 * x).to(torch.int64)]]

    with pytest.raises(UnknownOperation, match="indices that depend on the numbers"):
        record(looked_up)
