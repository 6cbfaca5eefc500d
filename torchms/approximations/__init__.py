"""Approximations in the `scattering` slot: compensations of what one bounce loses, and all bounces, distilled."""

from torchms.approximations.albedo_table import AlbedoTable as AlbedoTable
from torchms.approximations.distilled import Distilled as Distilled
from torchms.approximations.first_and_rest import FirstAndRest as FirstAndRest
from torchms.approximations.kulla_conty import KullaConty as KullaConty
from torchms.approximations.turquin import Turquin as Turquin
