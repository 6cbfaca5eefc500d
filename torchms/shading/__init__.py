"""World space: shading frames, light and view, roughness by name.

| here | in a BSDF | what it is |
|---|---|---|
| `view` | `wi` | towards the eye; a walk starts here, and where a model is not reciprocal its energy is that of the view |
| `light` | `wo` | towards the light; the cosine in a value is that of the light |

So `shade` is what a camera sees of a light: radiance, which is what `mode="radiance"` of a dielectric, its default, is for.
Who traces from the light swaps the two and takes `mode="importance"`; for models with `is_reciprocal` false (Turquin, the
uncorrelated and the correlated segment) that is another number, and this way round is the one they are written for.
"""

from torchms.shading.frame import ShadingFrame
from torchms.shading.roughness import CONVENTIONS, alpha, alphas
from torchms.shading.world import LightSample, sample, shade

__all__ = ["CONVENTIONS", "LightSample", "ShadingFrame", "alpha", "alphas", "sample", "shade"]
