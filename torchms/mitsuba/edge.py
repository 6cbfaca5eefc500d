"""Where a refraction ends: values jump there, and the place moves with the index and the directions.

Facets that refract wi into wo have normals along wi + η wo. D is not 0 on the horizon, so that f jumps to 0 where that normal
comes to lie below it. The derivative of an integral over directions is the integral of the derivative and what the edge
sweeps, which differentiation of values cannot see: a tenth of the derivative with respect to η at α = 0.4.
"""

import torch
from torch import Tensor

from torchms.maths.frame import Vec3, dot
from torchms.maths.numerics import safe_sqrt
from torchms.paths.refractive import Refractive

WIDTH = 0.15
"""Heights of the normal over which what is swept is spread. Wider is less noise, and more curvature that is neglected."""


def swept(vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor:
    """1, whose gradient makes that of an integral of one bounce right.

    It is that of a step S(h_z) as wide as `WIDTH`: S' = (4 − 6 x) / `WIDTH` over x = h_z / `WIDTH` in [0, 1], whose integral
    is 1 and whose mean is at 0, so that the error is of second order.
    """
    n = vertex.fresnel.relative_eta(torch.where(wi.z < 0, -1.0, 1.0).to(wi.z.dtype))
    h = Vec3(wi.x + n * wo.x, wi.y + n * wo.y, wi.z + n * wo.z)
    x = (h.z.abs() / (WIDTH * safe_sqrt(dot(h, h)).clamp_min(1e-6))).clamp_max(1.0)
    step = torch.where(wi.z * wo.z < 0, x * (4 - 3 * x), 0.0)
    return 1 + step - step.detach()
