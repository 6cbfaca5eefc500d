"""Rough surfaces: conductor, dielectric and diffuse."""

from torchms.bsdfs.base import BSDF as BSDF
from torchms.bsdfs.base import Albedo as Albedo
from torchms.bsdfs.base import DirectionSample as DirectionSample
from torchms.bsdfs.base import WalkSample as WalkSample
from torchms.bsdfs.rough_conductor import RoughConductor as RoughConductor
from torchms.bsdfs.rough_dielectric import RoughDielectric as RoughDielectric
from torchms.bsdfs.rough_diffuse import RoughDiffuse as RoughDiffuse
