"""Estimators of the sum over bounces."""

from torchms.estimators.base import Scattering
from torchms.estimators.bidirectional import Bidirectional
from torchms.estimators.height_walk import HeightWalk
from torchms.estimators.single_bounce import SingleBounce
from torchms.estimators.unidirectional import Unidirectional

__all__ = ["Bidirectional", "HeightWalk", "Scattering", "SingleBounce", "Unidirectional"]
