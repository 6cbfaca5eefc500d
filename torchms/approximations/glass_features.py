"""What the distilled lobes of rough glass are functions of: two directions, each seen from its own side.

What is reflected knows numbers that do not change when both directions are exchanged; what is transmitted, the direction
in the thinner medium, that in the denser one, and the ratio of the indices above 1.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations import pair_features as pair
from torchms.distributions.base import EllipticDistribution
from torchms.maths import frame
from torchms.maths.frame import Vec3, select
from torchms.paths.refractive import Refractive

REFLECTED, TRANSMITTED = 21, 22
"""Inputs of the networks of pairs."""
OF_ONE = 12
"""Inputs of those of one direction."""
NEAR = 0.005
"""What keeps ln(η − 1) finite."""
STEP = 0.2
"""Width of the step at total reflection."""


def reflected_features(shape: pair.Shape, log_eta: Tensor, i: pair.Seen, o: pair.Seen) -> list[Tensor]:
    """Inputs for two directions on one side, symmetric in them; η = n of the other side / n of this one."""
    along, across, stretched = pair.facing(shape, i, o)
    form, height, _ = pair.half_vector_features(shape, Vec3(i.w.x + o.w.x, i.w.y + o.w.y, i.w.z + o.w.z))
    cos2 = (1 + along + i.w.z * o.w.z) * 0.5
    excess = torch.exp(2 * log_eta) - 1
    # The square root of Fresnel's reflectance at normal incidence.
    amplitude = torch.tanh(log_eta / 2)
    return [
        *pair.shared(shape, i, o, along, across, stretched),
        form,
        height,
        torch.sqrt(cos2 + 1e-4),
        log_eta,
        torch.log(amplitude * amplitude + 1e-3),
        pair.root_sign(excess + cos2, STEP),
        pair.root_sign(excess + i.w.z * i.w.z, STEP) + pair.root_sign(excess + o.w.z * o.w.z, STEP),
        torch.log(cos2 / (amplitude * amplitude + 1e-4) + 0.1),
    ]


def transmitted_features(shape: pair.Shape, log_eta: Tensor, thin: pair.Seen, dense: pair.Seen) -> list[Tensor]:
    """Inputs for a direction in the thinner and one in the denser medium, each in the frame of its side; ln η > 0."""
    along, across, stretched = pair.facing(shape, thin, dense)
    n = torch.exp(log_eta)
    gap = torch.log(n - 1 + NEAR)
    a, b = thin.w, dense.w
    p = Vec3(n * b.x - a.x, n * b.y - a.y, n * b.z - a.z)
    form, height, length2 = pair.half_vector_features(shape, p)
    return [
        a.z,
        b.z,
        thin.masking,
        dense.masking,
        thin.height,
        dense.height,
        along,
        stretched,
        shape.log,
        shape.sum,
        shape.q * shape.q,
        pair.slanted(shape, a),
        pair.slanted(shape, b),
        across,
        pair.slanted(shape, p) / length2,
        form,
        height,
        torch.log(length2) - 2 * gap,
        log_eta,
        gap,
        torch.sqrt((1 + along + a.z * b.z) * 0.5 + 1e-4),
        pair.root_sign(1 - n * n * (1 - b.z * b.z), STEP),
    ]


def features_of_one(shape: pair.Shape, log_eta: Tensor, w: pair.Seen) -> list[Tensor]:
    """Inputs for one direction in the frame of its side; η = n of the other side / n of this one."""
    amplitude = torch.tanh(log_eta / 2)
    sx, sy = shape.ax * w.w.x, shape.ay * w.w.y
    return [
        w.height,
        w.w.z,
        torch.log(w.height + 1e-2),
        shape.log,
        shape.sum,
        shape.q * shape.q,
        pair.slanted(shape, w.w),
        shape.q * (sx * sx - sy * sy) / (w.length * w.length),
        log_eta,
        torch.log(amplitude * amplitude + 1e-3),
        pair.root_sign(torch.exp(2 * log_eta) - 1 + w.w.z * w.w.z, STEP),
        torch.sqrt(1 - w.height * w.height + 1e-4),
    ]


class Features(NamedTuple):
    """What networks of glass are functions of: light that is reflected, light that is transmitted, and one direction."""

    reflected: Callable[[pair.Shape, Tensor, pair.Seen, pair.Seen], list[Tensor]]
    transmitted: Callable[[pair.Shape, Tensor, pair.Seen, pair.Seen], list[Tensor]]
    of_one: Callable[[pair.Shape, Tensor, pair.Seen], list[Tensor]]


SYMMETRIC = Features(reflected_features, transmitted_features, features_of_one)
"""Those with the symmetries of the surface."""


class Pair(NamedTuple):
    """Two directions, each seen from its own side: wi, wo; the one in the thinner and that in the denser medium; whether light
    crosses; ln η of the first one's side, of both; the pair's |cos θ_o|, and whether both are off the horizon.
    """

    shape: pair.Shape
    i: pair.Seen
    o: pair.Seen
    thin: pair.Seen
    dense: pair.Seen
    crosses: Tensor
    log_eta: Tensor
    log_etas: Tensor
    cos: Tensor
    served: Tensor


def pair_of(vertex: Refractive, wi: Vec3, wo: Vec3) -> Pair:
    """Both directions, as these facets see them."""
    distribution = vertex.distribution
    assert isinstance(distribution, EllipticDistribution)
    w, side, _ = vertex.enter(wi)
    d, there, _ = vertex.enter(wo)
    assert side is not None and there is not None
    log_eta = torch.log(vertex.fresnel.relative_eta(side))
    i, o = pair.seen(distribution, pair.above(w)), pair.seen(distribution, pair.above(d))
    into_denser = log_eta > 0
    crosses = side != there
    # Seen from its own side, wo meets the inverse index if that is the other one.
    log_etas = torch.stack(torch.broadcast_tensors(log_eta, torch.where(crosses, -log_eta, log_eta)))
    served = (wi.z != 0) & (wo.z != 0)
    thin, dense = chosen(into_denser, i, o), chosen(into_denser, o, i)
    return Pair(pair.shape_of(distribution), i, o, thin, dense, crosses, log_eta, log_etas, d.z, served)


def inputs(found: Pair, features: Features = SYMMETRIC) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Features of the pair as light that is reflected, and as light that is transmitted; those of both directions (2, …)."""
    return (
        features.reflected(found.shape, found.log_eta, found.i, found.o),
        features.transmitted(found.shape, found.log_eta.abs(), found.thin, found.dense),
        features.of_one(found.shape, found.log_etas, stacked(found.i, found.o)),
    )


def stacked(a: pair.Seen, b: pair.Seen) -> pair.Seen:
    """Both, along a first axis."""
    rest = (torch.stack(torch.broadcast_tensors(x, y)) for x, y in zip(a[1:], b[1:], strict=True))
    return pair.Seen(frame.stacked(a.w, b.w), *rest)


def chosen(mask: Tensor, a: pair.Seen, b: pair.Seen) -> pair.Seen:
    """a where `mask`, else b."""
    rest = (torch.where(mask, x, y) for x, y in zip(a[1:], b[1:], strict=True))
    return pair.Seen(select(mask, a.w, b.w), *rest)
