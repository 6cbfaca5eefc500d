"""Approximations in the `scattering` slot: compensations of what one bounce loses, and all bounces, distilled."""

from torchms.approximations.albedo_table import AlbedoTable
from torchms.approximations.distilled import Distilled
from torchms.approximations.kulla_conty import KullaConty
from torchms.approximations.turquin import Turquin

__all__ = ["AlbedoTable", "Distilled", "KullaConty", "Turquin"]
