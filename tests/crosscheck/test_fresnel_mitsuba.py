"""Fresnel terms against Mitsuba 3's own."""

from types import ModuleType

import pytest
import torch

from torchms.fresnel import Conductor, Dielectric

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

COSINES = torch.linspace(0.01, 1, 100)


@pytest.fixture(scope="module")
def mi() -> ModuleType:
    """A variant as a module of its own: the process's current variant is left alone."""
    from importlib import import_module

    return import_module("mitsuba.scalar_rgb")


@pytest.mark.parametrize("eta", [1 / 1.5, 1.1, 1.33, 1.5, 2.4])
@pytest.mark.parametrize("side", [1, -1])
def test_dielectric(mi, eta, side):
    c = side * COSINES
    ours = Dielectric(eta)(c)[:, 0]
    theirs = torch.tensor([mi.fresnel(float(x), eta)[0] for x in c])
    # Both in float32; theirs subtracts where ours does not, and the critical angle amplifies either's rounding.
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=2e-6)


@pytest.mark.parametrize("metal", ["Ag", "Au", "Cu", "W"])
def test_conductor(mi, metal):
    from drjit.scalar import Complex2f

    model = Conductor.metal(metal)
    ours = model(COSINES)
    for channel in range(3):
        index = Complex2f(model.eta[channel].item(), model.k[channel].item())
        theirs = torch.tensor([float(mi.fresnel_conductor(float(x), index)) for x in COSINES])
        torch.testing.assert_close(ours[:, channel], theirs, rtol=1e-5, atol=1e-5)
