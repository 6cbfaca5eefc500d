"""What the lobe of a surface of its own is a function of: numbers of two directions that only exchanging them leaves alone.

A surface that was measured need not look the same in a mirror, or from behind: the lobe of a slope that rises gently and
falls steeply depends on the sign of x. Reciprocity is all that holds.
"""

import torch
from torch import Tensor

from torchms.approximations.metal_features import FEATURES, OF_ONE, features, features_of_one
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3

FREE = FEATURES + 8
"""Features of a pair."""
FREE_OF_ONE = OF_ONE + 3
"""Features of one direction."""


def free_features(distribution: EllipticDistribution, wi: Vec3, wo: Vec3) -> list[Tensor]:
    """The network's inputs for two directions above the horizon; the roughness is that of Beckmann with these slopes."""
    return [*features(distribution, wi, wo), *leaning(*distribution.alphas, wi, wo)]


def leaning(ax: Tensor, ay: Tensor, wi: Vec3, wo: Vec3) -> list[Tensor]:
    """What mirroring x or y changes, of two directions that may be exchanged."""
    half = Vec3(wi.x + wo.x, wi.y + wo.y, wi.z + wo.z)
    return [
        half.x,
        half.y,
        wi.x * wo.x - wi.y * wo.y,
        wi.x * wo.y + wi.y * wo.x,
        wi.x * wi.y + wo.x * wo.y,
        *tilted(ax, ay, half),
    ]


def tilted(ax: Tensor, ay: Tensor, half: Vec3) -> list[Tensor]:
    """Slopes of the facet along `half`, that would do it in one bounce: over α, and bounded."""
    p, q = half.x / (ax * half.z), half.y / (ay * half.z)
    inverse = torch.rsqrt(1 + p * p + q * q)
    return [p * inverse, q * inverse, p * q * inverse * inverse]


def free_features_of_one(distribution: EllipticDistribution, w: Vec3) -> list[Tensor]:
    """The inputs of the factor that each direction above the horizon brings."""
    return [*features_of_one(distribution, w), w.x, w.y, w.x * w.y]
