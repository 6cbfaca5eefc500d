"""Where light leaves rough metal whose further bounces have closed forms."""

from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

from torchms.approximations.metal_features import above
from torchms.approximations.metal_sampling import MetalProposal
from torchms.estimators.base import Exit, Scattering
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon
from torchms.paths.mirror import Mirror

Rest = Callable[[Vec3], tuple[list[Tensor], list[Tensor]]]
"""Of a direction above the horizon: f · cos θ_o of each further order, and what it is with F = 1 up to one factor."""


def metal_walk(
    vertex: Mirror,
    single: Scattering,
    proposal: MetalProposal,
    rest: Rest,
    wi: Vec3,
    u: Sequence[Tensor],
    factor: Callable[[Vec3], Tensor | None] = lambda d: None,
) -> Iterator[Exit]:
    """One bounce of `single`, then one exit for each order of `rest`, all along one direction.

    factor: of a direction, what a surface's single bounce is over that of `single`; None is 1.
    """
    # How often light leaves with the rest is chosen beforehand, close to how often it does: then the weights are right
    # whatever the choice.
    again = proposal.rest_share(wi)
    (first,) = single.walk(vertex, wi, u)
    weight, escapes = first.weight * (first.escapes / (1 - again)), (1 - again).expand_as(first.escapes)
    once = factor(first.d)
    if once is not None:
        weight = weight * once
    yield Exit(first.d, weight, escapes, first.transmitted)
    d = proposal.sample_rest(wi, u[1 + vertex.n_uniforms :])
    d = Vec3(d.x, d.y, d.z.clamp_min(horizon(d.z.dtype)))
    density = proposal.rest_density(above(wi), d)
    values, white = rest(d)
    total = sum(white[1:], white[0])
    for value, lobe in zip(values, white, strict=True):
        escapes = again * (lobe / total)
        yield Exit(d, value / (density * escapes), escapes, torch.zeros_like(first.transmitted))
