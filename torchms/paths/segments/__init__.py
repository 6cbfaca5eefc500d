"""Segment terms: the probability that light goes from bounce to bounce and then leaves, given its directions."""

from torchms.paths.segments.base import Joiner, Leg, Segment
from torchms.paths.segments.correlated import Correlated
from torchms.paths.segments.invariance import Invariance
from torchms.paths.segments.uncorrelated import Uncorrelated

__all__ = ["Correlated", "Invariance", "Joiner", "Leg", "Segment", "Uncorrelated"]
