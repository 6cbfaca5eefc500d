"""What the methods of a BSDF return, where it is more than one tensor."""

from typing import NamedTuple

from torch import Tensor


class DirectionSample(NamedTuple):
    """wo (*batch N 3), drawn with density `pdf` (*batch N) [1/sr], which is exact."""

    wo: Tensor
    pdf: Tensor


class WalkSample(NamedTuple):
    """Where a walk left: wo (*batch N 3), weight (*batch N C) and order (*batch N).

    The density of wo is unknown, and is not needed: E[weight · g(wo)] = ∫ f |cos θ_o| g dwo. A walk that had not left
    after `max_order` bounces has order 0 and weight 0.
    """

    wo: Tensor
    weight: Tensor
    order: Tensor


class Albedo(NamedTuple):
    """Energy that leaves on the side of wi and on the other side, each (*batch K C), per unit of incident energy."""

    reflected: Tensor
    transmitted: Tensor
