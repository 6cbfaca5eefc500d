"""torchms inside Mitsuba 3: `register()` or `set_variant(name)`, and then `torchms_conductor`, `torchms_dielectric`,
`torchms_diffuse` and `torchms_metallic_roughness` in a scene.
"""

from torchms.mitsuba.llvm import find_llvm
from torchms.mitsuba.plugin import register, set_variant

__all__ = ["find_llvm", "register", "set_variant"]
