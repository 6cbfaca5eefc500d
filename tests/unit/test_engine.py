"""Machine code of kernels: when it is made, what it shares, and that it gives what eager mode gives where numbers are hard."""

import pytest
import torch
from cases import COMPENSATIONS, SCATTERINGS, bsdf, models
from torch import nn

import torchms
from torchms import GGX, KullaConty, RoughConductor, SingleBounce, Stream, Turquin, Unidirectional
from torchms.approximations import AlbedoTable
from torchms.bsdfs import compile as compiled
from torchms.evaluation import engine, run
from torchms.fresnel import Conductor, Schlick
from torchms.paths.segments import Invariance
from torchms.testing.plain import edges


@pytest.fixture(autouse=True)
def compiler() -> None:
    if compiled._missing_compiler():
        pytest.skip("torchms.compile needs a C++ compiler")


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what is compiled from here on."""
    monkeypatch.setattr(engine, "_programs", {})
    names: list[str] = []
    announced = engine.Engine.announced
    monkeypatch.setattr(engine.Engine, "announced", lambda self, what: names.append(what) or announced(self, what))
    return names


def hemisphere(rows: int, generator: torch.Generator, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    w = torch.nn.functional.normalize(torch.randn(rows, 3, generator=generator, dtype=dtype), dim=-1)
    return torch.stack([w[:, 0], w[:, 1], w[:, 2].abs()], -1)


@pytest.mark.parametrize("make", [KullaConty, Turquin])
def test_fresh_tables_compile_nothing(make, generator: torch.Generator, counted: list[str]) -> None:
    """A compensation that is built anew in every step of a training: its tables are inputs, known by their contents."""
    wi = hemisphere(20, generator)
    for scale in (1.0, 0.5, 0.25):
        scattering = make(AlbedoTable.packaged("GGX"))
        scattering.tables["GGX"].c_round.mul_(scale)
        eager = RoughConductor(GGX(0.7), Schlick([0.9]), scattering)
        torch.testing.assert_close(torchms.compile(eager, verbose=False)(wi, wi), eager(wi, wi), rtol=2e-4, atol=2e-6)
    assert len(counted) == 1


def test_one_program_for_any_rows(generator: torch.Generator, counted: list[str]) -> None:
    """From one row on, whatever the strides, the paths and what wants a gradient."""
    alpha = nn.Parameter(torch.tensor(0.5))
    eager = RoughConductor(GGX(alpha), Conductor.metal("Cu"), Unidirectional(Invariance(), 2))
    fast = torchms.compile(eager, verbose=False)
    wi, wo = hemisphere(40_000, generator), hemisphere(40_000, generator)
    for rows, paths in ((1, 1), (2, 3), (17, 100), (600, 1), (40_000, 1), (1, 70_000)):
        u = Stream(3, paths)
        for a, b in ((wi, wo), (wi.T.contiguous().T, wo.T.contiguous().T)):
            value = fast(a[:rows], b[:rows], u)
            torch.testing.assert_close(value, eager(a[:rows], b[:rows], u), rtol=2e-4, atol=2e-6)
            with torch.no_grad():
                assert torch.equal(fast(a[:rows], b[:rows], u), value)
    assert len(counted) == 1
    fast(wi[:5], wo[:5], Stream(1)).sum().backward()
    assert counted[1:] == [f"backward of {counted[0]}"]


def test_both_directions_are_announced(
    generator: torch.Generator, capfd: pytest.CaptureFixture[str], monkeypatch
) -> None:
    """The line on stderr names the backward, too."""
    monkeypatch.setattr(engine, "_programs", {})
    wi = hemisphere(5, generator)
    fast = torchms.compile(RoughConductor(GGX(nn.Parameter(torch.tensor(0.5))), Schlick([0.9]), SingleBounce()))
    fast(wi, wi).sum().backward()
    lines = " ".join(capfd.readouterr().err.split())
    assert "torchms.compile: forward of RoughConductor" in lines and "torchms.compile: backward of forward" in lines


@pytest.mark.parametrize("device", ["meta"])
def test_parameters_elsewhere_run_eagerly(device: str, counted: list[str]) -> None:
    """Machine code is for the CPU: on another device a call is what it is without, with a word about it."""
    eager = RoughConductor(GGX(0.5), Schlick([0.9]), SingleBounce()).to(device)
    with pytest.warns(RuntimeWarning, match=f"on {device}.* runs eagerly"):
        fast = torchms.compile(eager, verbose=False)
    w = torch.zeros(4, 3, device=device)
    assert fast(w, w).shape == (4, 1) and fast(w, w).device.type == device and not counted


def test_threads_change_no_bit(generator: torch.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Values, sums over many paths, and gradients of what all rows share."""
    monkeypatch.setattr(run, "ELEMENTS", 1024)
    alpha = nn.Parameter(torch.tensor(0.5))
    fast = torchms.compile(RoughConductor(GGX(alpha), Schlick([0.3, 0.9]), SingleBounce()), verbose=False)
    wi, wo = hemisphere(9_001, generator), hemisphere(9_001, generator)
    found = []
    try:
        for n in (1, 2, 4):
            torch.set_num_threads(n)
            value = fast(wi, wo)
            found.append((value, *torch.autograd.grad(value.square().sum(), alpha), *fast.sample(wi, Stream(3, 2))))
    finally:
        torch.set_num_threads(1)
    for other in found[1:]:
        assert all(torch.equal(a, b) for a, b in zip(other, found[0], strict=True))


@pytest.mark.parametrize("exact", [False, pytest.param(True, marks=pytest.mark.slow)])
@models(scatterings=["single", "invariance", "height-walk", *COMPENSATIONS])
def test_hard_numbers(material, scattering, exact, generator: torch.Generator) -> None:
    """Poles, horizons, both sides, h = 0: no guard is lost where sums are rounded otherwise."""
    eager = bsdf(material, scattering, alpha=(0.6,), max_order=2)
    fast = torchms.compile(eager, verbose=False, exact=exact)
    wi, wo = edges()
    u = eager.uniforms(wi.shape[:-1], 2, generator=generator)
    for name, given in (("orders", (wi, wo, u)), ("pdf", (wi, wo)), ("albedo", (wi, u)), ("sample_walk", (wi, u))):
        found, expected = getattr(fast, name)(*given), getattr(eager, name)(*given)
        for a, b in zip(*((x if isinstance(x, tuple) else (x,)) for x in (found, expected)), strict=True):
            torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-12)


def test_exact_rounds_like_eager(generator: torch.Generator) -> None:
    """Without contraction a single bounce rounds as eager code does, with it differently.

    On some processors the roots of torch are not rounded correctly: there it is within one unit in the last place.
    """
    eager = RoughConductor(GGX(0.5, 0.3), Conductor.metal("Au"), SingleBounce())
    wi, wo = hemisphere(5_000, generator), hemisphere(5_000, generator)
    expected = eager(wi, wo)
    off = [
        float(
            ((torchms.compile(eager, verbose=False, exact=exact)(wi, wo) - expected).abs() / expected.abs()).nanmean()
        )
        for exact in (True, False)
    ]
    x = torch.rand(5_000, generator=generator)
    rounded = torch.equal(x.sqrt(), x.double().sqrt().float())
    assert off[0] <= off[1] and off[0] < (2e-8 if rounded else 1.2e-7)


def test_second_derivatives_and_transforms(generator: torch.Generator) -> None:
    """Where there is no machine code for it, a compiled BSDF gives what the eager one gives."""
    alpha = torch.tensor(0.5, dtype=torch.float64)
    wi, wo = hemisphere(6, generator, torch.float64), hemisphere(6, generator, torch.float64)

    def value(alpha: torch.Tensor, fast: bool) -> torch.Tensor:
        eager = RoughConductor(GGX(alpha), Schlick(torch.tensor([0.5], dtype=torch.float64)), SingleBounce())
        return (torchms.compile(eager, verbose=False) if fast else eager)(wi, wo).sum()

    second = []
    for fast in (True, False):
        leaf = alpha.clone().requires_grad_()
        (first,) = torch.autograd.grad(value(leaf, fast), leaf, create_graph=True)
        second.append(torch.autograd.grad(first, leaf)[0])
    torch.testing.assert_close(*second)
    torch.testing.assert_close(
        torch.func.grad(lambda a: value(a, True))(alpha), torch.func.grad(lambda a: value(a, False))(alpha)
    )


def test_what_is_exchanged_is_noticed(generator: torch.Generator) -> None:
    """Numbers, tensors, dtypes and parts of a BSDF that was called before, also where calls are alike."""
    eager = RoughConductor(GGX(0.5), Schlick([0.5, 0.9]), SingleBounce())
    fast = torchms.compile(eager, verbose=False)
    wi, wo = hemisphere(7, generator), hemisphere(7, generator)

    def same() -> None:
        plain = RoughConductor(fast.distribution, fast.fresnel, fast.scattering)
        torch.testing.assert_close(fast(wi, wo), plain(wi, wo), rtol=1e-5, atol=1e-7)

    fast(wi, wo)
    fast.distribution.get_buffer("alpha").fill_(0.3)
    same()
    fast.distribution.alpha = torch.linspace(0.2, 0.8, 7)
    same()
    fast.fresnel.f0 = torch.tensor([0.1, 0.2])
    same()
    fast.fresnel = Schlick([0.2])
    same()
    fast.distribution = torchms.Beckmann(0.4, 0.2)
    same()
    fast.distribution.alpha.data = torch.tensor(0.7)
    same()
    fast.scattering = Unidirectional(Invariance(), 1)
    same()
    assert fast.double()(wi.double(), wo.double()).dtype == torch.float64


@pytest.mark.slow
def test_every_scattering_has_machine_code(recwarn: pytest.WarningsRecorder) -> None:
    """No kernel of the tables runs eagerly behind the word "compiled"."""
    w = torch.tensor([[0.6, 0.0, 0.8]], dtype=torch.float64)
    for scattering in (*SCATTERINGS, *COMPENSATIONS):
        if "bidirectional" in scattering:
            continue
        fast = torchms.compile(bsdf("conductor[conductor]", scattering, max_order=2), verbose=False)
        fast(w, w, Stream(1))
    assert not [w for w in recwarn if "runs eagerly" in str(w.message)]
