"""What all tests share: one seed, one significance budget, and a way to see messages behind the type checks."""

import zlib
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import jaxtyping
import pytest
import torch
from cases import SCATTERINGS

from torchms.testing import combined, sidak

SEED = 20261122
"""A changed seed is a bug report, not a fix."""

FAMILY_LEVEL = 1e-3
"""Probability that the suite, slow tests included, fails somewhere although every law holds."""

STATISTICAL_TESTS = 2000
"""Room for so many statistical tests (items that use `budget`); collection fails when there are more."""

LEVEL = sidak(FAMILY_LEVEL, STATISTICAL_TESTS)

# The kernels work on blocks that are too small to be worth sharing; xdist is what uses the cores.
torch.set_num_threads(1)


COSTLY = {
    "test_engine.py::test_hard_numbers": ("kulla-conty", "turquin"),
    "test_distilled_export.py": ("dielectric",),
    "test_files.py::test_parity_over_the_tables": ("kulla-conty",),
    "test_yardstick.py": ("beckmann",),
    "test_distilled.py": ("beckmann",),
    "test_distilled_glass.py": ("beckmann",),
    "test_gradient.py::test_gradcheck": ("bidirectional-correlated", "diffuse-bidirectional"),
}
"""Where a test has quick cases enough without those that have one of these words in their name."""


def is_costly(item: pytest.Item) -> bool:
    """What costs most together; each part has its quick cases with something cheaper.

    In the laws all scatterings of GGX are quick, and of Beckmann those that walk no path.
    """
    where = item.nodeid.rpartition("/")[2]
    if any(where.startswith(place) and any(word in item.name for word in words) for place, words in COSTLY.items()):
        return True
    if item.path.name == "test_blocks.py":
        return "correlated" in item.name
    if item.path.name == "test_engine.py":
        return "diffuse" in item.name and "single" not in item.name
    if item.path.name == "test_finite.py" and "float64" in item.name and "single" not in item.name:
        return True
    if "beckmann" not in item.name or "laws" not in item.path.parts:
        return item.path.name == "test_reference_lobes.py" and "beckmann" in item.name
    named = getattr(item, "callspec", None)
    parameters = named.params if named else {}
    walks = parameters.get("scattering") in SCATTERINGS and parameters["scattering"] != "single"
    return walks or "segment" in parameters or "bidirectional" in item.nodeid


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if is_costly(item):
            item.add_marker(pytest.mark.slow)
    statistical = sum("budget" in getattr(item, "fixturenames", ()) for item in items)
    if statistical > STATISTICAL_TESTS:
        raise pytest.UsageError(f"{statistical} statistical tests share a budget for {STATISTICAL_TESTS}: raise it.")


class Budget:
    """One statistical test's share of the significance: to be called once, with all its p-values."""

    def __init__(self) -> None:
        self.spent = False

    def __call__(self, p_values: torch.Tensor, label: Callable[[int], object] = lambda index: index) -> None:
        """Fail if the least of the p-values is too small for so many; `label(i)` names the i-th in the message."""
        assert not self.spent, "a statistical test has one share of the budget: give it all p-values at once"
        self.spent = True
        p_values = torch.as_tensor(p_values, dtype=torch.float64).reshape(-1)
        p = combined(p_values)
        worst = int(p_values.nan_to_num(0).argmin())
        assert p > LEVEL, (
            f"p = {p:.2g} for {p_values.numel()} comparisons, the level is {LEVEL:.2g}; "
            f"worst: {label(worst)} with p = {float(p_values[worst]):.2g}"
        )


@pytest.fixture
def budget() -> Budget:
    """Every comparison with statistical noise is judged by this."""
    return Budget()


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    """A number of this test's own, the same in every run."""
    return SEED + zlib.crc32(request.node.nodeid.encode())


@pytest.fixture
def generator(seed: int) -> torch.Generator:
    """Random numbers of this test's own, the same in every run."""
    return torch.Generator().manual_seed(seed)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """A library that sets the threads of the process would make every later test slow: the test that calls it fails."""
    yield
    left = torch.get_num_threads()
    torch.set_num_threads(1)
    assert left == 1


@pytest.fixture
def messages() -> Iterator[None]:
    """Without the types' run-time checks, which would answer before torchms does: what a user sees."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def variant() -> Iterator[Callable[[str], Any]]:
    """Mitsuba in a variant, with the plugins."""
    from torchms.mitsuba import register

    mi = import_module("mitsuba")
    before = mi.variant()

    def set_variant(name: str) -> Any:
        mi.set_variant(name)
        register()
        return mi

    yield set_variant
    if before is not None:
        mi.set_variant(before)
