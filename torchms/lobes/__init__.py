"""Energies and directional histograms of any model, for one incident direction."""

from torchms.lobes.measure import measure
from torchms.lobes.tally import Lobes, Tally

__all__ = ["Lobes", "Tally", "measure"]
