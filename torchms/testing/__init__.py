"""Laws that a BSDF must obey, as checks: normalisation and chi², the white furnace, reciprocity, agreement in z.

The checks return numbers (p-values, estimates); what they must be is for the caller to say. Random numbers are arguments.
"""

from torchms.testing.chi_square import chi_square, chi_square_p_value
from torchms.testing.furnace import furnace
from torchms.testing.quadrature import sphere_cells
from torchms.testing.reciprocity import reciprocal_pair
from torchms.testing.zscore import (
    Estimate,
    combined,
    estimate,
    exactly,
    p_value,
    share_z_score,
    sidak,
    z_score,
)

__all__ = [
    "Estimate",
    "chi_square",
    "chi_square_p_value",
    "combined",
    "estimate",
    "exactly",
    "furnace",
    "p_value",
    "reciprocal_pair",
    "share_z_score",
    "sidak",
    "sphere_cells",
    "z_score",
]
