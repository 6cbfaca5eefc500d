"""Laws that a BSDF must obey, as checks: normalisation and chi², the white furnace, reciprocity, agreement in z.

`law_suite(bsdf)` tries every law that applies to an object, also one of your own. The other checks return numbers (p-values,
estimates); what they must be is for the caller to say. Random numbers are arguments.
"""

from torchms.testing.chi_square import chi_square, chi_square_p_value
from torchms.testing.furnace import furnace
from torchms.testing.quadrature import sphere_cells
from torchms.testing.reciprocity import reciprocal_pair
from torchms.testing.report import Law, Report
from torchms.testing.suite import law_suite
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
    "Law",
    "Report",
    "chi_square",
    "chi_square_p_value",
    "combined",
    "estimate",
    "exactly",
    "furnace",
    "law_suite",
    "p_value",
    "reciprocal_pair",
    "share_z_score",
    "sidak",
    "sphere_cells",
    "z_score",
]
