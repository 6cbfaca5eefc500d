"""Estimators of the sum over bounces."""

from torchms.estimators.base import Scattering as Scattering
from torchms.estimators.bidirectional import Bidirectional as Bidirectional
from torchms.estimators.height_walk import HeightWalk as HeightWalk
from torchms.estimators.single_bounce import SingleBounce as SingleBounce
from torchms.estimators.unidirectional import Unidirectional as Unidirectional
