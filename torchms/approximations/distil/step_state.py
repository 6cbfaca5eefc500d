"""Where a fit by damped Newton steps stands, on disk."""

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

MOST_BYTES = 1 << 24


class StepState(NamedTuple):
    """Weights, damping of the next step, and how many steps were taken."""

    vector: Tensor
    damping: float
    step: int

    def keep(self, checkpoint: Path) -> None:
        """Put it at `checkpoint`, whole, in place of what is there."""
        file = io.BytesIO()
        np.savez(file, step=np.array(self.step), vector=self.vector.numpy(), damping=np.array(self.damping))
        write_whole(checkpoint, file.getvalue(), force=True)


def kept(checkpoint: Path, begin: StepState) -> StepState:
    """What `checkpoint` holds, or `begin` where nothing was kept; ValueError for a damaged file."""
    if not checkpoint.exists():
        return begin
    found = read_arrays(checkpoint, MOST_BYTES)
    return StepState(torch.from_numpy(found["vector"]), float(found["damping"]), int(found["step"]))
