"""A simulated surface against a model of it: how far what leaves after each bounce is apart, in standard errors."""

from typing import NamedTuple

import torch
from torch import Tensor

from torchms.lobes.tally import Tally
from torchms.testing.zscore import Estimate, zscore

ROUNDING = 1e-9
"""Of an energy: the simulator counts in whole steps of less."""


class Differences(NamedTuple):
    """(surface − model) in standard errors of the difference; NaN where that is not known (one group of paths).

    reflected, transmitted: (K, C), the orders that both have. total: (C,), all that left.
    """

    reflected: Tensor
    transmitted: Tensor
    total: Tensor


def against(surface: Tally, model: Tally) -> Differences:
    """How far the energies of `surface` are from those of `model`, which has as many channels, or one of them has one."""
    K = min(len(surface.reflected), len(model.reflected))

    def z(name: str, rows: slice | None = None) -> Tensor:
        estimates = []
        for tally in (surface, model):
            mean, error = getattr(tally, name), getattr(tally, f"{name}_stderr")
            estimates.append(Estimate(*((mean, error) if rows is None else (mean[rows], error[rows])), tally.n))
        found = zscore(*estimates, rounding=ROUNDING)
        return torch.where(estimates[0].stderr.isfinite() & found.isfinite(), found, torch.nan)

    return Differences(z("reflected", slice(K)), z("transmitted", slice(K)), z("total"))
