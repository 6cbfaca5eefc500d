"""BRDFs of real surfaces, from files that others measured."""

from torchms.measured.rgl import MeasuredBRDF
from torchms.measured.tensor_file import read_tensor_file

__all__ = ["MeasuredBRDF", "read_tensor_file"]
