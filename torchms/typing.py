"""Shape aliases of the public surface. Shapes are types: they are enforced under pytest, and only there, in the modules that
import them (setup.cfg has the list).

`*#batch` broadcasts. Kernels inside the package work on components and are annotated with plain `Tensor`.
"""

from jaxtyping import Bool, Float, Int
from torch import Tensor

Direction = Float[Tensor, "*#batch 3"]
"""Unit vector in the local frame (+z is the macro-normal) that points away from the surface."""

Scalar = Float[Tensor, "*#batch"]
Mask = Bool[Tensor, "*#batch"]
Count = Int[Tensor, "*#batch"]

Spectrum = Float[Tensor, "*#batch C"]
"""One number a channel; the channel axis stays, even for C = 1."""

Orders = Float[Tensor, "*#batch K C"]
"""`[..., k - 1, :]` is what left after exactly k bounces."""

Uniforms = Float[Tensor, "*#batch N D"]
"""N independent paths of D numbers in [0, 1) each."""

# Of each of the N directions that a sample has.
Scalars = Float[Tensor, "*#batch N"]
Spectra = Float[Tensor, "*#batch N C"]
EachOrders = Float[Tensor, "*#batch N K C"]

Pair = Float[Tensor, "*#batch 2"]
