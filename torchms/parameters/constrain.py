"""Parameters that an optimizer may move freely, because the module maps them into their range.

    gold = RoughConductor(GGX(0.3), Schlick([0.9, 0.7, 0.4]), HeightWalk())
    constrain(gold, "distribution.alpha", "fresnel.f0")  # now they are in gold.parameters()
    optimizer = torch.optim.Adam(gold.parameters(), lr=0.02)

`gold.distribution.alpha` is still α. Built on `torch.nn.utils.parametrize`, which also undoes it
(`remove_parametrizations(gold.distribution, "alpha")`).
"""

import math
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn.utils import parametrize

from torchms.parameters.declared import Parametric, first_bad
from torchms.parameters.exchange import parameters

UNBOUNDED = 1e5
"""A range that reaches further than this has no upper end worth a curve: softplus instead of a sigmoid."""

M = TypeVar("M", bound=nn.Module)


class Interval(nn.Module):
    """Any real number to (low, high): low + (high − low) · sigmoid(x)."""

    def __init__(self, low: float, high: float) -> None:
        super().__init__()
        self.low, self.high = low, high

    def forward(self, x: Tensor) -> Tensor:
        return self.low + (self.high - self.low) * torch.sigmoid(x)

    def right_inverse(self, value: Tensor) -> Tensor:
        return torch.logit((value - self.low) / (self.high - self.low))


class Above(nn.Module):
    """Any real number to (low, ∞): low + softplus(x)."""

    def __init__(self, low: float) -> None:
        super().__init__()
        self.low = low

    def forward(self, x: Tensor) -> Tensor:
        return self.low + nn.functional.softplus(x)

    def right_inverse(self, value: Tensor) -> Tensor:
        # x = ln(e^y − 1) = y + ln(1 − e^−y).
        y = value - self.low
        return y + torch.log(-torch.expm1(-y))


def constrain(module: M, *names: str, low: float | None = None, high: float | None = None) -> M:
    """Make the parameters called `names` trainable, within the range that `module` allows; `module` itself is returned.

    names: of declared parameters, with dots for those of a child ("distribution.alpha", "fresnel.eta"). low, high:
    a narrower range; `low=1.0` for the index of glass. A value must lie strictly inside of it, as a sigmoid does not reach
    its ends. Raises ValueError, with the names there are, for a name that is none, for a parameter without a value, one
    that is constrained already, an empty or wider range, and a value outside.
    """
    for name in names:
        path, _, leaf = name.rpartition(".")
        owner = dict(module.named_modules()).get(path)
        if not isinstance(owner, Parametric) or leaf not in owner.declared:
            raise ValueError(f"constrain({name!r}): no such parameter; there are {', '.join(parameters(module))}.")
        _constrain(owner, leaf, name, low, high)
    return module


def _constrain(owner: Parametric, leaf: str, name: str, low: float | None, high: float | None) -> None:
    value = getattr(owner, leaf)
    if value is None:
        raise ValueError(f"constrain({name!r}): it has no value, as it follows another parameter. Give it one first.")
    if parametrize.is_parametrized(owner, leaf):
        raise ValueError(
            f"constrain({name!r}): it is constrained already. Undo that with "
            "torch.nn.utils.parametrize.remove_parametrizations."
        )
    record = owner.declared[leaf]
    low, high = record.low if low is None else low, record.high if high is None else high
    if not record.low <= low < high <= record.high:
        raise ValueError(
            f"constrain({name!r}, low=..., high=...) must be a range within {record.range}; got [{low:g}, {high:g}]."
        )
    outside = ~((value.detach() > low) & (value.detach() < high))
    if bool(outside.any()):
        raise ValueError(
            f"constrain({name!r}): the value must lie inside of ({low:g}, {high:g}), its ends excluded; "
            f"got {first_bad(outside, value)}. Start it away from the ends."
        )
    if not isinstance(value, nn.Parameter):
        # A buffer becomes a parameter; a graph behind it would not be followed any longer.
        if value.requires_grad and not value.is_leaf:
            raise ValueError(f"constrain({name!r}): it is computed from other tensors. Constrain those instead.")
        delattr(owner, leaf)
        owner.register_parameter(leaf, nn.Parameter(value.detach().clone()))
    bounded = high < UNBOUNDED and math.isfinite(high)
    parametrize.register_parametrization(owner, leaf, Interval(low, high) if bounded else Above(low))
