"""Laws that a BSDF must obey, as checks: normalisation and chi², the white furnace, reciprocity, agreement in z.

`law_suite(bsdf)` tries every law that applies to an object, also one of your own. The other checks return numbers (p-values,
estimates); what they must be is for the caller to say. Random numbers are arguments.
"""

from torchms.testing.chi_square import chi_square, chi_square_p_value
from torchms.testing.furnace import white_furnace
from torchms.testing.quadrature import sphere_cells
from torchms.testing.reciprocity import reciprocity
from torchms.testing.report import Law, Report
from torchms.testing.suite import law_suite
from torchms.testing.zscore import (
    Estimate,
    combined,
    estimate,
    exactly,
    p_value,
    share_zscore,
    sidak,
    zscore,
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
    "law_suite",
    "p_value",
    "reciprocity",
    "share_zscore",
    "sidak",
    "sphere_cells",
    "white_furnace",
    "zscore",
]
