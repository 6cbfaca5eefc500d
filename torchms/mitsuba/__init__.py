"""torchms inside Mitsuba 3: `register()`, and then `torchms_conductor`, `torchms_dielectric`, `torchms_diffuse` in a scene."""

from torchms.mitsuba.llvm import find_llvm
from torchms.mitsuba.plugin import register

__all__ = ["find_llvm", "register"]
