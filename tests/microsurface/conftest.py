"""What the microsurface tests share."""

from collections.abc import Iterator

import jaxtyping
import pytest


@pytest.fixture
def plain_messages() -> Iterator[None]:
    """Without the types' run-time checks, which would answer before torchms does: what a user sees."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)
