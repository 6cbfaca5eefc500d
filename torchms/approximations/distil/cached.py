"""Blocks of data on disk, one file each, so that a stopped run goes on where it was."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

MOST_BYTES = 1 << 28


def blocks(
    folder: Path, count: int, made: Callable[[int], dict[str, Tensor]], advance: Callable[[int], None]
) -> dict[str, Tensor]:
    """The first `count` blocks, joined; those that are not in `folder` are `made`, by their number, and put there."""
    parts = []
    for number in range(count):
        path = folder / f"block-{number:05d}.npz"
        if not path.exists():
            file = io.BytesIO()
            arrays: dict[str, Any] = {name: x.numpy() for name, x in made(number).items()}
            np.savez(file, **arrays)
            write_whole(path, file.getvalue(), force=True)
        parts.append(read_arrays(path, MOST_BYTES))
        advance(1)
    return {name: torch.from_numpy(np.concatenate([part[name] for part in parts])) for name in parts[0]}
