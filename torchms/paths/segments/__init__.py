"""Segment terms: the probability that light goes from bounce to bounce and then leaves, given its directions."""

from torchms.paths.segments.base import Leg as Leg
from torchms.paths.segments.base import Segment as Segment
from torchms.paths.segments.correlated import Correlated as Correlated
from torchms.paths.segments.invariance import Invariance as Invariance
from torchms.paths.segments.uncorrelated import Uncorrelated as Uncorrelated
