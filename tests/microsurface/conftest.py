"""What the microsurface tests share."""

import sys
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest

# The one program that starts, kills and starts again is a benchmark.
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))


@pytest.fixture
def plain_messages() -> Iterator[None]:
    """Without the types' run-time checks, which would answer before torchms does: what a user sees."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)
