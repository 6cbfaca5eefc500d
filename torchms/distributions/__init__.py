"""Microfacet distributions: D, Λ on the whole sphere, visible normals from any direction."""

from torchms.distributions.base import MicrofacetDistribution
from torchms.distributions.beckmann import Beckmann
from torchms.distributions.ggx import GGX

__all__ = ["GGX", "Beckmann", "MicrofacetDistribution"]
