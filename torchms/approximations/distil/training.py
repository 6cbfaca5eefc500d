"""The training of a network: relative squares against noisy targets, and energies that add up to one.

A target y is an unbiased estimate, and Σ w (p − y)² has its minimum at p = E[y] for every weight w that does not see y.
Here w = 1 / (p² + floor²) with p held: relative squares where the lobe is high.
"""

import math
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from torchms.approximations.albedo_table import AlbedoTable
from torchms.approximations.distil.adam_state import AdamState
from torchms.approximations.distil.energies import Cells
from torchms.approximations.distil.rows import KINDS, Rows
from torchms.approximations.distil.weights import Heads, Inputs, Weights
from torchms.approximations.metal_features import features, features_of_one
from torchms.maths.frame import split
from torchms.sampling.uniforms import generator_for, integers

BATCH = 8192
CELLS = 4
"""Directions of incidence whose energy a step looks at."""
RATE, LAST_RATE = 6e-3, 2e-5
FIRST = 0.3
"""Share of one bounce's value that a row's error is measured by, if that is more than all others."""
SIDE, TAIL, ENERGY = 0.3, 0.003, 300.0
"""Weights of the orders, of the tail's length and of the energies, against that of the lobe."""


@torch.no_grad()
def inputs_of(
    kind: str,
    rows: Rows,
    step: int = 8192,
    functions: tuple[Callable[..., list[Tensor]], Callable[..., list[Tensor]]] = (features, features_of_one),
) -> Inputs:
    """The features; functions: which ones, of a pair and of one direction."""
    of_pair, of_one = functions
    parts: list[list[Tensor]] = [[], [], []]
    for start in range(0, len(rows.ax), step):
        some = rows.part(slice(start, start + step))
        distribution, wi, wo = KINDS[kind](some.ax, some.ay), split(some.wi), split(some.wo)
        given = of_pair(distribution, wi, wo), *(of_one(distribution, w) for w in (wi, wo))
        for column, found in zip(parts, given, strict=True):
            column.append(torch.stack(torch.broadcast_tensors(*found), -1))
    return Inputs(*(torch.cat(column) for column in parts))


@torch.no_grad()
def floors(kind: str, rows: Rows, first: Tensor, step: int = 8192) -> Tensor:
    """f [1/sr] below which errors do not count more: of the rest's own size, and of that of the whole lobe.

    first: f of one bounce (n) [1/sr], beside which the rest may be small.
    """
    table = AlbedoTable.packaged(kind)
    parts = []
    for start in range(0, len(rows.ax), step):
        some = rows.part(slice(start, start + step))
        distribution = KINDS[kind](some.ax, some.ay)
        loss = table.loss(distribution, split(some.wi)) * table.loss(distribution, split(some.wo))
        size = loss / (math.pi * table.mean_loss(distribution))
        # The root mean square of a lobe of one bounce is about 0.11 / √(α_x α_y).
        lobe = 0.11 / torch.sqrt(some.ax * some.ay) / some.wo[:, 2].clamp_min(0.2)
        parts.append(torch.sqrt((0.3 * size) ** 2 + (0.1 * lobe) ** 2))
    return torch.hypot(torch.cat(parts), FIRST * first)


def loss(outputs: Tensor, targets: Tensor, floor: Tensor) -> Tensor:
    """Mean squares of a batch."""
    heads = Heads(outputs)
    f = targets[:, 1:4]
    held = heads.level.detach()
    weight = 1 / (held * held + floor * floor)
    orders = heads.level[:, None] * heads.shares
    last = held * heads.shares[:, 2].detach()
    main = (weight * (heads.level - f.sum(-1)) ** 2).mean()
    side = (weight[:, None] * (orders - f) ** 2).sum(-1).mean()
    tail = (weight * (last * (4 + heads.rest) - targets[:, 4]) ** 2).mean()
    return main + SIDE * side + TAIL * tail


def trained(
    weights: Weights,
    inputs: Inputs,
    targets: Tensor,
    floor: Tensor,
    cells: Cells,
    steps: int,
    seed: int,
    checkpoint: Path,
    advance: Callable[[int], None],
) -> Tensor:
    """The weights after `steps` steps of Adam, from `checkpoint` on if there is one."""
    generator = generator_for(seed)
    state = AdamState.begun(weights.initial(generator), checkpoint)
    starts = integers(0, len(floor) - BATCH + 1, (steps,), generator)
    looks = integers(0, len(cells.lost) - CELLS + 1, (steps,), generator)
    advance(state.step)
    for step in range(state.step, steps):
        rows = slice(int(starts[step]), int(starts[step]) + BATCH)
        value = loss(weights.outputs(state.vector, inputs.part(rows)), targets[rows], floor[rows])
        some = cells.part(int(looks[step]), CELLS)
        energy = some.energies(Heads(weights.outputs(state.vector, some.inputs)).level)
        value = value + ENERGY * ((energy - some.lost) ** 2).mean()
        state.take(value, RATE, LAST_RATE, steps)
        advance(1)
    return state.vector.detach()
