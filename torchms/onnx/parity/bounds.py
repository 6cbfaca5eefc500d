"""How near to eager an exported file must come, by what is in it."""

import math
from dataclasses import dataclass

import torch

from torchms.bsdfs import RoughDielectric
from torchms.distributions import GGX
from torchms.onnx.graph import Graph


@dataclass(frozen=True)
class Bounds:
    """What a file must keep.

    max, p999: relative errors against eager in its dtype, of all elements and of 99.9 % of them. rms_ratio: its RMS
    error over eager's, against float64, both without the sensitive elements. sensitive: share of elements above `max` for
    which eager itself is no better determined.
    """

    max: float
    p999: float
    rms_ratio: float = 3.0
    sensitive: float = 1e-5


SINGLE = Bounds(max=5e-6, p999=5e-6)
STEEP = Bounds(max=5e-6, p999=5e-6, sensitive=1e-3)
"""One bounce where float32 itself is not that good: glass, whose half vector cancels, and Beckmann's exponential."""
SAMPLE = Bounds(max=1e-3, p999=1e-5, sensitive=1e-4)
"""A direction and its density: near a tiny alpha one ulp of the direction moves the density."""
MULTIPLE = Bounds(max=1e-3, p999=1e-5, sensitive=5e-5)
GLASS = Bounds(max=1e-3, p999=1e-5, sensitive=1e-4)
"""Several bounces through glass: more branches, and orders that are small differences."""
DOUBLE = Bounds(max=1e-12, p999=1e-12, rms_ratio=math.inf)


def bounds_of(graph: Graph) -> Bounds:
    """The bounds that hold for this file."""
    if graph.bsdf.dtype == torch.float64:
        return DOUBLE
    glass = isinstance(graph.bsdf, RoughDielectric)
    if graph.what == "sample":
        return SAMPLE
    if not graph.draws:
        return SINGLE if isinstance(graph.bsdf.distribution, GGX) and not glass else STEEP
    return GLASS if glass else MULTIPLE
