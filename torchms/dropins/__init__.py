"""Functions of other projects under their own names, with their shapes and conventions, and all bounces of light.

| function | of | cosine | roughness |
|---|---|---|---|
| `GGX_specular` | TensoIR, Relightable 3D Gaussians, IRGS | the caller's | α = r² |
| `pbr_bsdf` | nvdiffrec and its descendants | in the value | α = r² |
| `pypbr.CookTorranceBRDF` | PyPBR | in the value | α = r |

`bounces=1` is the formula of the project, to compare. The tables that renderers look energies up in are made by `torchms lut`.
"""

from torchms.dropins import pypbr
from torchms.dropins.positions import pbr_bsdf
from torchms.dropins.specular import GGX_specular

__all__ = ["GGX_specular", "pbr_bsdf", "pypbr"]
