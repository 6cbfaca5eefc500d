"""Compensations of what one bounce loses, in the `scattering` slot: closed forms over albedo tables."""

from torchms.approximations.albedo_table import AlbedoTable
from torchms.approximations.kulla_conty import KullaConty
from torchms.approximations.turquin import Turquin

__all__ = ["AlbedoTable", "KullaConty", "Turquin"]
