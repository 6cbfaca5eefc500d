"""Simulated light paths as rows: where each came from and where it left, after how many bounces; no bins."""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.distil.rows import surfaces
from torchms.evaluation.workers import Workers
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster, GridTracer
from torchms.microsurface.simulation.exits import exits, stretched
from torchms.microsurface.simulation.materials import MirrorFacets
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.sampling.uniforms import draw, generator_for
from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

SIZE = 1024
"""Texels along each edge of a Gaussian tile, 16 a correlation length."""
BATCHES, RAYS = 16, 8192
"""Roughnesses of one block, and paths of each."""
LONGEST = 30
"""Most bounces that are followed."""
MOST_BYTES = 1 << 28
COLUMNS = ("ax", "ay", "wi", "wo", "order", "steep")

Made = Callable[[int], dict[str, np.ndarray]]
"""The rows of a block, by its number."""


class Light(NamedTuple):
    """Paths that left: α_x and α_y (n), wi and wo (n, 3), order (n) int64 and Σ (1 − c)⁵ (n)."""

    ax: Tensor
    ay: Tensor
    wi: Tensor
    wo: Tensor
    order: Tensor
    steep: Tensor


def gaussian_block(alpha: tuple[float, float], seed: int, number: int) -> dict[str, np.ndarray]:
    """Light on one Gaussian tile that is stretched to BATCHES roughnesses; every path has a direction of its own."""
    caster = GridTracer().bind(Grid.of(Heightfield.gaussian(1.0, size=SIZE, seed=seed * 1000 + number)))
    where = surfaces(alpha, BATCHES * RAYS, generator_for(seed * 1_000_003 + number))
    parts = []
    for k in range(BATCHES):
        ax, ay = float(where.ax[k]), float(where.ay[k])
        parts.append(_traced(stretched(caster, ax, ay), (ax, ay), where.wi[k * RAYS : (k + 1) * RAYS], (number, k)))
    return {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}


def surface_block(caster: GridCaster, alpha: tuple[float, float], seed: int, number: int) -> dict[str, np.ndarray]:
    """Light on one explicit surface."""
    wi = surfaces((0.1, 1.0), BATCHES * RAYS, generator_for(seed * 1_000_003 + number)).wi
    return _traced(caster, alpha, wi, (seed, number))


def _traced(caster: GridCaster, alpha: tuple[float, float], wi: Tensor, key: tuple[int, int]) -> dict[str, np.ndarray]:
    unit = wi.double().numpy()
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    found = exits(caster, MirrorFacets(), unit, np.array(key, dtype=np.uint32), LONGEST)
    ax, ay = (np.full(len(unit), a, dtype=np.float32) for a in alpha)
    return {
        "ax": ax,
        "ay": ay,
        "wi": unit.astype(np.float32),
        "wo": found.wo,
        "order": found.order,
        "steep": found.steep,
    }


def made(folder: Path, numbers: Sequence[int], block: Made, threads: int, advance: Callable[[int], None]) -> None:
    """Write those of the blocks `numbers` that are not in `folder`, whole or not at all."""

    def one(number: int) -> None:
        path = folder / f"light-{number:05d}.npz"
        if not path.exists():
            file = io.BytesIO()
            arrays = block(number)
            np.savez(file, **{name: arrays[name] for name in COLUMNS})
            write_whole(path, file.getvalue(), force=True)

    with Workers(threads) as workers:
        for _ in workers.map(one, numbers):
            advance(1)


def loaded(folder: Path, count: int, most: int, seed: int) -> Light:
    """Paths of the first `count` blocks in a random order: all, or `most` of them."""
    parts: list[dict[str, np.ndarray]] = []
    share = min(1.0, most / (count * BATCHES * RAYS))
    for number in range(count):
        block = read_arrays(folder / f"light-{number:05d}.npz", MOST_BYTES)
        u = draw((len(block["order"]),), 1, 1, generator=generator_for(seed + number)).flatten().numpy()
        kept = (block["order"] > 0) & (u < share)
        parts.append({name: block[name][kept] for name in COLUMNS})
    columns = [torch.from_numpy(np.concatenate([part[name] for part in parts])) for name in COLUMNS]
    mixed = torch.randperm(len(columns[0]), generator=generator_for(seed))
    ax, ay, wi, wo, order, steep = (x[mixed] for x in columns)
    return Light(ax, ay, wi, wo, order.long(), steep)
