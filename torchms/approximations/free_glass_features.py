"""What the glass lobe of a surface of its own is a function of: also numbers that mirroring it changes.

See `free_features`. Each direction is seen from its own side: turned over in the origin, a surface keeps its slopes.
"""

import torch
from torch import Tensor

from torchms.approximations import pair_features as pair
from torchms.approximations.free_features import leaning, tilted
from torchms.approximations.glass_features import (
    OF_ONE,
    REFLECTED,
    TRANSMITTED,
    Features,
    features_of_one,
    reflected_features,
    transmitted_features,
)
from torchms.maths.frame import Vec3

FREE_REFLECTED, FREE_TRANSMITTED, FREE_OF_ONE = REFLECTED + 8, TRANSMITTED + 9, OF_ONE + 3
LEAST = 1e-3
"""What keeps the slopes of a refracting facet finite."""


def _reflected(shape: pair.Shape, log_eta: Tensor, i: pair.Seen, o: pair.Seen) -> list[Tensor]:
    return [*reflected_features(shape, log_eta, i, o), *leaning(shape.ax, shape.ay, i.w, o.w)]


def _transmitted(shape: pair.Shape, log_eta: Tensor, thin: pair.Seen, dense: pair.Seen) -> list[Tensor]:
    a, b, n = thin.w, dense.w, torch.exp(log_eta)
    half = Vec3(n * b.x - a.x, n * b.y - a.y, (n * b.z - a.z).abs() + LEAST)
    return [
        *transmitted_features(shape, log_eta, thin, dense),
        a.x,
        a.y,
        b.x,
        b.y,
        a.x * b.x - a.y * b.y,
        a.x * b.y + a.y * b.x,
        *tilted(shape.ax, shape.ay, half),
    ]


def _of_one(shape: pair.Shape, log_eta: Tensor, w: pair.Seen) -> list[Tensor]:
    return [*features_of_one(shape, log_eta, w), w.w.x, w.w.y, w.w.x * w.w.y]


FREE = Features(_reflected, _transmitted, _of_one)
"""Those of which nothing but reciprocity is known."""
