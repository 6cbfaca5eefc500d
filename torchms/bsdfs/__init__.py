"""Rough surfaces: conductor, dielectric, diffuse, and metallic-roughness."""

from torchms.bsdfs.base import BSDF as BSDF
from torchms.bsdfs.metallic_roughness import MetallicRoughness as MetallicRoughness
from torchms.bsdfs.results import Albedo as Albedo
from torchms.bsdfs.results import DirectionSample as DirectionSample
from torchms.bsdfs.results import WalkSample as WalkSample
from torchms.bsdfs.rough_conductor import RoughConductor as RoughConductor
from torchms.bsdfs.rough_dielectric import RoughDielectric as RoughDielectric
from torchms.bsdfs.rough_diffuse import RoughDiffuse as RoughDiffuse
