"""Rough surfaces: conductor, dielectric and diffuse."""

from torchms.bsdfs.base import BSDF, Albedo, DirectionSample, WalkSample
from torchms.bsdfs.rough_conductor import RoughConductor
from torchms.bsdfs.rough_dielectric import RoughDielectric
from torchms.bsdfs.rough_diffuse import RoughDiffuse

__all__ = ["BSDF", "Albedo", "DirectionSample", "RoughConductor", "RoughDielectric", "RoughDiffuse", "WalkSample"]
