"""What the distilled lobe of a metal is a function of: numbers of two directions with the symmetries of the surface.

Exchanging both directions changes none of them, nor does mirroring x or y of both, nor exchanging x and y together with
α_x and α_y: with q = (α_x − α_y) / (α_x + α_y), which changes its sign, a pair of numbers (a_x, a_y) enters as a_x + a_y
and as q (a_x − a_y). For α_x = α_y the latter are 0, and what is left does not depend on the azimuth of the pair.
"""

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3

ROUND = 8
"""Features of a surface with α_x = α_y; the others are 0 there."""
FEATURES = 13
OF_ONE = 7
"""Features of one direction."""
ROUND_OF_ONE = 4
"""Those of a surface with α_x = α_y."""


def above(w: Vec3) -> Vec3:
    """`w`, and the normal in place of what is not above the horizon: nothing there is divided by."""
    up = w.z > 0
    return Vec3(torch.where(up, w.x, 0.0), torch.where(up, w.y, 0.0), torch.where(up, w.z, 1.0))


def features(distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> list[Tensor]:
    """The network's inputs for two directions above the horizon; the first ROUND of them for an isotropic surface."""
    ax, ay = distribution.alphas
    ax2, ay2 = ax * ax, ay * ay
    x, y, z = wi.x + wo.x, wi.y + wo.y, wi.z + wo.z
    xx, yy, zz = wi.x * wo.x, wi.y * wo.y, wi.z * wo.z
    # The cosines of both stretched directions, which masking depends on.
    stretched = _length2(wi, ax2, ay2) * _length2(wo, ax2, ay2)
    # The half vector, divided by α: its slopes are those of the facet that would do it in one bounce.
    hx, hy = x * x / ax2, y * y / ay2
    h2 = hx + hy
    along = xx + yy
    found = [
        z - 1,
        zz,
        along,
        torch.log(zz / torch.sqrt(stretched) + 1e-3) / 3,
        torch.log(1 + h2 / (z * z + 1e-4)) / 3,
        # The cosine at that facet; the addend keeps the root's gradient finite for opposite directions.
        torch.sqrt((1 + along + zz) / 2 + 1e-6),
        torch.log((ax + ay) / 2),
        torch.log(1 + h2) / 3,
    ]
    if distribution.alpha_y is None:
        return found
    q = (ax - ay) / (ax + ay)
    dx, dy = wi.x - wo.x, wi.y - wo.y
    return [
        *found,
        q * q,
        q * (xx - yy),
        q * (wi.x * wi.x + wo.x * wo.x - (wi.y * wi.y + wo.y * wo.y)),
        q * torch.log((1 + hx) / (1 + hy)) / 3,
        q * torch.log((1 + dx * dx / ax2) / (1 + dy * dy / ay2)) / 3,
    ]


def _length2(w: Vec3, ax2: Tensor, ay2: Tensor) -> Tensor:
    """Squared length of the stretched direction."""
    return ax2 * (w.x * w.x) + ay2 * (w.y * w.y) + w.z * w.z


def features_of_one(distribution: EllipticDistribution, w: Vec3) -> list[Tensor]:
    """The inputs of the factor that each direction above the horizon brings."""
    ax, ay = distribution.alphas
    ax2, ay2 = ax * ax, ay * ay
    length2 = _length2(w, ax2, ay2)
    # The stretched direction's cosine; the addend keeps the root's gradient finite.
    cos = torch.sqrt(w.z * w.z / length2 + 1e-12)
    q = (ax - ay) / (ax + ay)
    xx, yy = w.x * w.x, w.y * w.y
    found = [
        cos,
        w.z,
        torch.log(cos + 1e-2) / 3,
        torch.log((ax + ay) / 2),
        q * q,
        q * (xx - yy),
        q * (ax2 * xx - ay2 * yy) / length2,
    ]
    return found if distribution.alpha_y is not None else found[:ROUND_OF_ONE]
