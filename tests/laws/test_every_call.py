"""Every method of every surface, however it is called: numbers given or streamed, parameters as numbers or as maps, one
row or many, eager or compiled."""

from collections.abc import Iterator

import pytest
import torch
from cases import METHODS, NUMBERS, TOLERANCES, alphas_for, bsdf, directions, is_dear, surfaces
from torch import Tensor

import torchms
from torchms import BSDF, Stream
from torchms.bsdfs import compile as compiled
from torchms.parameters.exchange import parameters, with_parameters

ROWS, PATHS = 5, 2


def mapped(surface: BSDF, rows: int) -> BSDF:
    """The same surface, each parameter as a map that falls by a tenth from its first row to its last."""
    fall = torch.linspace(1.0, 0.9, rows, dtype=surface.dtype)
    maps = {
        name: value * (fall[:, None] if record.channels else fall)
        for name, (record, value) in parameters(surface).items()
    }
    return with_parameters(surface, maps)


def row_of(surface: BSDF, rows: slice) -> BSDF:
    """Some rows of a surface of maps."""
    return with_parameters(surface, {name: value[rows] for name, (_, value) in parameters(surface).items()})


def case(material: str, scattering: str, distribution: str, dtype: torch.dtype = torch.float64) -> BSDF:
    return bsdf(material, scattering, distribution, alphas_for(material, scattering), max_order=2, dtype=dtype)


def called(surface: BSDF, method: str, wi: Tensor, wo: Tensor, u: Tensor | Stream) -> list[Tensor]:
    return list(METHODS[method](surface, wi, wo, u))


def check_forms(surface: BSDF, forms: list[str], wi: Tensor, wo: Tensor) -> dict[str, list[Tensor]]:
    """The results of every method, the same to the bit for all `forms` of the random numbers."""
    u = [NUMBERS[form]((ROWS,), PATHS, surface.n_uniforms) for form in forms]
    results = {}
    for method in METHODS:
        results[method] = called(surface, method, wi, wo, u[0])
        for other in u[1:] if method != "pdf" else ():
            found = called(surface, method, wi, wo, other)
            assert all(torch.equal(a, b) for a, b in zip(found, results[method], strict=True)), method
    return results


@surfaces()
def test_eager(material, scattering, distribution, generator):
    """A stream is its numbers; a row is what it is alone, with its own parameters, directions and seed."""
    wi, wo = directions(ROWS, generator), directions(ROWS, generator)
    plain = case(material, scattering, distribution)
    check_forms(plain, ["stream", "tensor"], wi, wo)
    maps = mapped(plain, ROWS)
    results = check_forms(maps, ["tensor", "seeds"], wi, wo)
    here = slice(3, 4)
    stream = Stream(Stream(11).seeds((ROWS,))[here], PATHS)
    rtol, atol = TOLERANCES[torch.float64]
    for method, together in results.items():
        alone = called(row_of(maps, here), method, wi[here], wo[here], stream)
        for a, b in zip(alone, together, strict=True):
            torch.testing.assert_close(a, b[here], rtol=1e3 * rtol, atol=1e3 * atol)


COMPILED_QUICK = {
    ("conductor[conductor]", "single", "ggx", "sample_walk"),
}
"""What the quick suite compiles: a compilation takes seconds."""


def compilations() -> Iterator[object]:
    for model in surfaces().args[1]:
        for method in METHODS:
            key = (*model.values, method)
            if is_dear(model.values[2], model.values[1]):
                continue  # an hour of C++ each; an export of them is a test of its own
            marks = [] if key in COMPILED_QUICK else [pytest.mark.slow]
            yield pytest.param(*key, marks=marks, id="-".join(key))


@pytest.mark.parametrize("material,scattering,distribution,method", list(compilations()))
def test_compiled(material, scattering, distribution, method, generator):
    """As eager, on several rows and on one, on numbers and on a stream; choices that rounding decides set apart."""
    if compiled._missing_compiler():
        pytest.skip("torchms.compile needs a C++ compiler")
    rows = 50
    wi, wo = (directions(rows, generator, dtype=torch.float32) for _ in range(2))
    plain = case(material, scattering, distribution, torch.float32)
    for surface in (plain, mapped(plain, rows)):
        fast = torchms.compile(surface, verbose=False)
        for u in (Stream(11, PATHS), Stream(11, PATHS).uniforms((rows,), surface.n_uniforms)):
            found, expected = called(fast, method, wi, wo, u), called(surface, method, wi, wo, u)
            for a, b in zip(found, expected, strict=True):
                assert a.shape == b.shape and a.dtype == b.dtype
                same = torch.isclose(a, b, rtol=1e-3, atol=1e-4)
                assert float(same.double().mean()) > 0.98
    one = called(torchms.compile(plain, verbose=False), method, wi[:1], wo[:1], Stream(11, PATHS))
    expected = called(plain, method, wi[:1], wo[:1], Stream(11, PATHS))
    assert all(torch.allclose(a, b, rtol=1e-3, atol=1e-4) for a, b in zip(one, expected, strict=True))
