"""The scattering of an opaque surface for which none is named."""

import contextlib

from torchms.approximations.distilled import Distilled
from torchms.distributions.base import EllipticDistribution
from torchms.estimators.base import Scattering
from torchms.estimators.unidirectional import Unidirectional
from torchms.paths.segments import Invariance
from torchms.paths.vertex import Vertex


def usual(vertex: Vertex) -> Scattering:
    """All bounces without noise where they are distilled, and their estimate elsewhere."""
    if isinstance(vertex.distribution, EllipticDistribution):
        distilled = Distilled()
        with contextlib.suppress(ValueError):
            distilled.check(vertex)
            return distilled
    return Unidirectional(Invariance())
