"""The same bits for any number of threads, blocks and processes; copies, pickles and state dicts are the object again."""

import copy
import io
import multiprocessing
import pickle
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from cases import COMPENSATIONS, SCATTERINGS, bsdf, directions, each, models
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from torchms import BSDF, GGX, Bidirectional, Invariance, RoughConductor, Stream, Unidirectional, constrain
from torchms.evaluation import blocks
from torchms.fresnel import Conductor

ROWS = 300
METHODS = {
    "orders": lambda s, wi, wo, u: [s.orders(wi, wo, u)],
    "pdf": lambda s, wi, wo, u: [s.pdf(wi, wo)],
    "sample": lambda s, wi, wo, u: s.sample(wi, u),
    "sample_walk": lambda s, wi, wo, u: s.sample_walk(wi, u),
    "albedo": lambda s, wi, wo, u: s.albedo(wi, u),
}


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def everything(surface: BSDF, rows: int = ROWS, seed: int = 5, paths: int = 1) -> list[Tensor]:
    """What every method gives for `rows` directions."""
    generator = torch.Generator().manual_seed(seed)
    wi, wo = (directions(rows, generator, 0.05, surface.dtype) for _ in range(2))
    u = surface.uniforms((rows,), paths, generator=generator)
    return [part for method in METHODS.values() for part in method(surface, wi, wo, u)]


def same_bits(a: list[Tensor], b: list[Tensor]) -> bool:
    return len(a) == len(b) and all(torch.equal(x, y) for x, y in zip(a, b, strict=True))


def gold() -> RoughConductor:
    return RoughConductor(GGX(0.4, 0.2), Conductor.metal("Au"), Bidirectional(Invariance(), 3))


@models(scatterings=["single", "invariance", "height-walk", "turquin"])
def test_threads_change_no_bit(material, scattering, threads, monkeypatch):
    """Over a block that is large enough for torch to share it out, and over the usual ones."""
    surface = bsdf(material, scattering, alpha=(0.6,), max_order=2, dtype=torch.float32)
    for block, rows in ((1 << 17, 40_000), (8192, 9_001)):
        monkeypatch.setattr(blocks, "BLOCK", block)
        monkeypatch.setattr(blocks, "SPLIT", block)
        torch.set_num_threads(1)
        one = everything(surface, rows)
        for n in (2, 4):
            torch.set_num_threads(n)
            assert same_bits(everything(surface, rows), one), f"{n} threads, blocks of {block}"


@models(scatterings=["single", "invariance", "height-walk", "turquin"])
def test_blocks_of_any_size_change_no_bit(material, scattering, monkeypatch):
    """One path a row; blocks hold a multiple of 64 rows, however the batch ends."""
    surface = bsdf(material, scattering, alpha=(0.6,), max_order=3, dtype=torch.float32)
    whole = everything(surface, 1037)
    for size in (100, 129, 600, 1 << 20):
        monkeypatch.setattr(blocks, "BLOCK", size)
        assert same_bits(everything(surface, 1037), whole), f"blocks of {size}"


@models(scatterings=["single", "invariance", "height-walk", "turquin"])
@each("size", ["17", "100"])
def test_blocks_that_cut_paths_change_last_bits_only(material, scattering, size, monkeypatch):
    """More paths than a block holds, in float64: sums are taken in another order, and nothing else changes."""
    surface = bsdf(material, scattering, alpha=(0.6,), max_order=3)
    whole = everything(surface, 3, paths=110)
    monkeypatch.setattr(blocks, "BLOCK", int(size))
    for part, expected in zip(everything(surface, 3, paths=110), whole, strict=True):
        torch.testing.assert_close(part, expected, rtol=1e-12, atol=1e-15)


def test_concurrent_calls(threads):
    """Of one object, from eight threads of Python at once, values and gradients."""
    surface = gold()
    alone = [everything(surface, seed=seed) for seed in range(16)]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda seed: everything(surface, seed=seed), range(16)))
    assert all(same_bits(a, b) for a, b in zip(alone, together, strict=True))

    def slope(seed: int) -> Tensor:
        alpha = torch.tensor(0.4, requires_grad=True)
        here = RoughConductor(GGX(alpha, 0.2), Conductor.metal("Au"), Unidirectional(Invariance(), 3))
        return torch.autograd.grad(everything(here, seed=seed)[0].sum(), alpha)[0]

    expected = [slope(seed) for seed in range(8)]
    with ThreadPoolExecutor(4) as pool:
        assert all(torch.equal(a, b) for a, b in zip(pool.map(slope, range(8)), expected, strict=True))


# Copies.


@models(scatterings=[*SCATTERINGS, *COMPENSATIONS])
def test_copies_and_pickles_are_the_object_again(material, scattering):
    surface = bsdf(material, scattering, alpha=(0.6,), max_order=3)
    expected = everything(surface)
    for other in (copy.deepcopy(surface), copy.copy(surface), pickle.loads(pickle.dumps(surface))):
        assert same_bits(everything(other), expected)
        assert repr(other) == repr(surface)
    deep = copy.deepcopy(surface)
    deep.distribution.get_buffer("alpha").fill_(0.1)
    assert same_bits(everything(surface), expected), "a deep copy shares nothing"


@models(scatterings=["single", "height-walk", "kulla-conty"])
def test_state_dicts_carry_the_numbers(material, scattering):
    """Into a surface of other numbers, through a file that is read without unpickling objects."""
    surface, other = (bsdf(material, scattering, alpha=(alpha,), max_order=3) for alpha in (0.6, 0.2))
    file = io.BytesIO()
    torch.save(surface.state_dict(), file)
    file.seek(0)
    other.load_state_dict(torch.load(file, weights_only=True))
    assert same_bits(everything(other), everything(surface))


def test_a_constrained_surface_keeps_its_state():
    """Trained parameters live behind `constrain`: state dicts carry them, deep copies train apart."""
    surface, other = gold(), gold()
    for each_surface in (surface, other):
        constrain(each_surface.distribution, "alpha")
    with torch.no_grad():
        for parameter in surface.parameters():
            parameter.add_(0.3)
    assert not same_bits(everything(other), everything(surface))
    other.load_state_dict(surface.state_dict())
    assert same_bits(everything(other), everything(surface))
    assert same_bits(everything(copy.deepcopy(surface)), everything(surface))


# Processes.


class Rows(Dataset[Tensor]):
    """Item i is what a surface of its own makes of the stream's row i."""

    def __init__(self, surface: BSDF) -> None:
        self.surface = surface

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int) -> Tensor:
        return row(self.surface, index)


def row(surface: BSDF, index: int) -> Tensor:
    w = torch.tensor([0.6, 0.0, 0.8])
    return surface.orders(w, w, Stream(torch.tensor(index), 8))


@pytest.mark.parametrize("method", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_workers_of_a_data_loader(method, threads):
    """Two workers give the bits of none; a fork after threads were used does not hang."""
    surface = gold()
    torch.set_num_threads(2)
    everything(surface, 9_000)
    expected = torch.stack([row(surface, index) for index in range(6)])
    loader = DataLoader(
        Rows(surface),
        batch_size=2,
        num_workers=2,
        multiprocessing_context=multiprocessing.get_context(method),
        timeout=90,
    )
    assert torch.equal(torch.cat(list(loader)), expected)


def test_another_process_gives_the_same_bits():
    """A fresh interpreter, another number of threads, the surface handed over as a pickle on its standard input."""
    surface = gold()
    program = (
        "import sys, pickle, torch; torch.set_num_threads(2); surface = pickle.load(sys.stdin.buffer)\n"
        "from torchms import Stream\n"
        "w = torch.tensor([0.6, 0.0, 0.8])\n"
        "value = surface.orders(w, w, Stream(torch.tensor(3), 8))\n"
        "sys.stdout.buffer.write(value.numpy().tobytes())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], input=pickle.dumps(surface), capture_output=True, timeout=120, check=True
    )
    assert done.stdout == row(surface, 3).numpy().tobytes()
