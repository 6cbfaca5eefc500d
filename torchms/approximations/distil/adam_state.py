"""Adam's steps on one vector, with rates that fall to the end, and where they stand on disk."""

import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

SAVED = 500
"""Steps between two checkpoints."""
WARM = 100
"""Steps in which the rate rises."""
LONGEST = 0.5
"""Gradients are cut to that length."""
MOST_BYTES = 1 << 24


@dataclass
class AdamState:
    """The vector, how many steps were taken, and Adam's means."""

    vector: Tensor
    step: int
    optimizer: torch.optim.Adam
    checkpoint: Path

    @classmethod
    def begun(cls, vector: Tensor, checkpoint: Path) -> "AdamState":
        """At `vector`, or where `checkpoint` is if there is one; ValueError for a damaged file."""
        vector = vector.clone().requires_grad_(True)
        optimizer = torch.optim.Adam([vector], betas=(0.9, 0.99))
        if not checkpoint.exists():
            return cls(vector, 0, optimizer, checkpoint)
        arrays = read_arrays(checkpoint, MOST_BYTES)
        with torch.no_grad():
            vector.copy_(torch.from_numpy(arrays["vector"]))
        optimizer.state[vector] = {
            "step": torch.tensor(float(arrays["step"])),
            "exp_avg": torch.from_numpy(arrays["mean"]),
            "exp_avg_sq": torch.from_numpy(arrays["square"]),
        }
        return cls(vector, int(arrays["step"]), optimizer, checkpoint)

    def take(self, loss: Tensor, rate: float, last: float, steps: int) -> None:
        """One step of `steps` on `loss`; kept on disk from time to time."""
        falls = 0.5 * (1 + math.cos(math.pi * self.step / steps))
        self.optimizer.param_groups[0]["lr"] = rate * min(1.0, (self.step + 1) / WARM) * falls + last
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_([self.vector], LONGEST)
        self.optimizer.step()
        self.step += 1
        if self.step % SAVED == 0 or self.step == steps:
            self.keep()

    def keep(self) -> None:
        """Put it on disk, whole, in place of what is there."""
        state = self.optimizer.state[self.vector]
        file = io.BytesIO()
        arrays = {"vector": self.vector.detach(), "mean": state["exp_avg"], "square": state["exp_avg_sq"]}
        np.savez(file, step=np.array(self.step), **{name: x.numpy() for name, x in arrays.items()})
        write_whole(self.checkpoint, file.getvalue(), force=True)
