"""Microfacet distributions: D, Λ on the whole sphere, visible normals from any direction."""

from torchms.distributions.base import MicrofacetDistribution as MicrofacetDistribution
from torchms.distributions.beckmann import Beckmann as Beckmann
from torchms.distributions.ggx import GGX as GGX
from torchms.distributions.gtr import GTR as GTR
from torchms.distributions.tabulated import Tabulated as Tabulated
