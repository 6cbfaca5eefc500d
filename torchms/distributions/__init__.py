"""Microfacet distributions: D, Λ on the whole sphere, visible normals from any direction."""

from torchms.distributions.base import MicrofacetDistribution
from torchms.distributions.beckmann import Beckmann
from torchms.distributions.ggx import GGX
from torchms.distributions.gtr import GTR

__all__ = ["GGX", "GTR", "Beckmann", "MicrofacetDistribution"]
