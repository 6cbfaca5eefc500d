"""What some of the shards found, in whole numbers."""

from dataclasses import dataclass
from typing import Any

import numpy as np

COUNTERS = ("rays", "segments", "casts", "repeats", "leaked_segments")
MEASURED = ("slope_variance_x", "slope_variance_y", "slope_distance_x", "slope_distance_y")


@dataclass
class Partial:
    """What some of the shards found, in whole numbers (steps of 1/UNIT of a path's energy): sums depend on no order.

    The first axis of the energies is the group that standard errors are taken over, see `Plan.group`.
    """

    reflected: np.ndarray
    transmitted: np.ndarray
    remaining: np.ndarray
    leaked: np.ndarray
    lobes: np.ndarray
    counts: np.ndarray
    measured: np.ndarray

    @staticmethod
    def zeros(groups: int, surfaces: int, orders: int, channels: int, lobes: bool) -> "Partial":
        """Nothing found yet."""
        from torchms.microsurface.simulation.settle import N_COS, N_PHI, PLANES

        planes = PLANES if lobes else 0
        return Partial(
            reflected=np.zeros((groups, orders, channels), dtype=np.int64),
            transmitted=np.zeros((groups, orders, channels), dtype=np.int64),
            remaining=np.zeros((groups, channels), dtype=np.int64),
            leaked=np.zeros((groups, channels), dtype=np.int64),
            lobes=np.zeros((groups, planes, N_COS, N_PHI, channels), dtype=np.int64),
            counts=np.zeros((groups, len(COUNTERS)), dtype=np.int64),
            measured=np.zeros((surfaces, len(MEASURED))),
        )

    def arrays(self) -> dict[str, Any]:
        """All arrays by name."""
        return dict(vars(self))

    def add(self, found: "Partial", group: int, surface: int) -> None:
        """Add the result of one shard (one group, one surface)."""
        for name, mine in self.arrays().items():
            theirs = found.arrays()[name][0]
            if name == "measured":
                mine[surface] = theirs
            else:
                mine[group] += theirs
