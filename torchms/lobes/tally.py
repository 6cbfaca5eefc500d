"""What any model, estimator or simulation reports for one incident direction: energies per order and lobes."""

from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor


@dataclass(frozen=True)
class Lobes:
    """Directional histogram of the light that leaves, binned in cos θ_o × φ_o.

    mean: (P, n_cos, n_phi, C) mean of f · |cos θ_o| over each bin [1/sr]; the planes are the orders 1 … P − 1 and
    then the sum over all orders. stderr: the same shape, standard error of `mean`.
    cos θ_o runs over equal bins from −1 to 1, φ_o over equal bins from 0 to 2π. A bin's solid angle is `bin_sr`.
    """

    mean: Tensor
    stderr: Tensor

    @property
    def bin_sr(self) -> float:
        """Solid angle of one bin [sr]."""
        return 4 * torch.pi / (self.mean.shape[1] * self.mean.shape[2])


@dataclass(frozen=True)
class Tally:
    """Share of the incident energy that leaves after exactly k bounces, k = 1 … K (float64, no η² factor).

    reflected, transmitted: (K, C) with standard errors beside them; `transmitted` is what leaves on the other side.
    remaining: (C,) what had not left after K bounces (not absorbed: still inside); `total`: (C,) sum of all that left.
    n: number of paths. lobes: histogram, if it was asked for. info: configuration and diagnostics, JSON-serialisable.
    """

    reflected: Tensor
    transmitted: Tensor
    reflected_stderr: Tensor
    transmitted_stderr: Tensor
    total: Tensor
    total_stderr: Tensor
    remaining: Tensor
    remaining_stderr: Tensor
    n: int
    lobes: Lobes | None = None
    info: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The energies as nested lists, ready for JSON; lobes are left out (they are large)."""
        names = ("reflected", "transmitted", "reflected_stderr", "transmitted_stderr")
        names += ("total", "total_stderr", "remaining", "remaining_stderr")
        return {name: getattr(self, name).tolist() for name in names} | {"n": self.n, "info": self.info}
