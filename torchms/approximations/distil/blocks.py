"""The rows and targets of a distillation on disk: one file a block, so that a stopped run goes on where it was."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.distil import rows as where
from torchms.approximations.distil.rows import Rows
from torchms.approximations.distil.targets import COLUMNS, estimated
from torchms.sampling.uniforms import generator_for
from torchms.storage.archives import read_arrays
from torchms.storage.write import read_json, write_json, write_whole

ROWS = 65536
"""Rows of a block, that of compiled code."""
CONFIGURATION = "configuration.json"


def opened(folder: Path, configuration: dict[str, Any]) -> Path:
    """`folder`, made if need be, for runs of this configuration; ValueError if it holds another one's."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CONFIGURATION
    mine = json.loads(json.dumps(configuration))
    if not path.exists():
        write_json(path, mine, force=True)
    elif (theirs := read_json(path)) != mine:
        differing = [
            f"{key}: {theirs.get(key)} there, {mine[key]} asked for" for key in mine if theirs.get(key) != mine[key]
        ]
        raise ValueError(
            f"{folder} holds a distillation of other options ({'; '.join(differing)}). Name another folder."
        )
    return folder


def made(
    folder: Path,
    kind: str,
    alpha: tuple[float, float],
    seed: int,
    n_paths: tuple[int, int],
    numbers: list[int],
    advance: Callable[[int], None],
) -> None:
    """Write those of the blocks `numbers` that are not there."""
    for number in numbers:
        path = _path(folder, number)
        if not path.exists():
            rows, lobe = where.drawn(kind, alpha, ROWS, generator_for(seed * 1_000_003 + number))
            targets = estimated(kind, rows, 2 * (seed * 4096 + number), n_paths)
            file = io.BytesIO()
            np.savez(file, rows=_joined(rows, lobe).numpy(), targets=targets.numpy())
            write_whole(path, file.getvalue(), force=True)
        advance(1)


def loaded(folder: Path, count: int) -> tuple[Rows, Tensor, Tensor]:
    """Rows, their shares in the square of a lobe (n) and targets (n, COLUMNS) of the first `count` blocks."""
    parts = [read_arrays(_path(folder, number), 1 << 26) for number in range(count)]
    joined = torch.from_numpy(np.concatenate([part["rows"] for part in parts]))
    targets = torch.from_numpy(np.concatenate([part["targets"] for part in parts]))
    if targets.shape[1] != COLUMNS or joined.shape != (len(targets), 9):
        raise ValueError(f"{folder} holds blocks of another version. Name another folder.")
    return Rows(joined[:, 0], joined[:, 1], joined[:, 2:5], joined[:, 5:8]), joined[:, 8], targets


def _path(folder: Path, number: int) -> Path:
    return folder / f"block-{number:05d}.npz"


def _joined(rows: Rows, lobe: Tensor) -> Tensor:
    return torch.cat([rows.ax[:, None], rows.ay[:, None], rows.wi, rows.wo, lobe[:, None]], 1)
