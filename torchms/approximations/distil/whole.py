"""Damped Newton steps that look at all rows: slope and value of everything, and a matrix that some rows are enough for."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.energies import Cells
from torchms.approximations.distil.level import Level
from torchms.approximations.distil.refinement import CHUNK, LARGEST, SMALLEST, Data, energy_weights, row_weights
from torchms.approximations.distil.step_state import StepState, kept
from torchms.approximations.distil.weights import Inputs, Weights
from torchms.sampling.uniforms import draw, generator_for, integers

POINTS = 64
"""Outgoing directions of each energy in the matrix; the slope takes all of them."""
MATRIX = 1 << 12
"""Rows whose derivatives are held at a time."""


class Held(NamedTuple):
    """Value of the objective, half its slope; weights of rows and of energies, which stay within a step, and the rows' g."""

    value: float
    slope: Tensor
    rows: Tensor
    energies: Tensor
    g: Tensor


def refined(
    weights: Weights,
    vector: Tensor,
    data: Data,
    cells: Cells,
    steps: int,
    seed: int,
    checkpoint: Path,
    advance: Callable[[int], None],
    size: int,
) -> Tensor:
    """`vector` after `steps` of them; each is kept in `checkpoint`, and gone on from. size: rows of the matrix."""
    level = Level(weights)
    vector, damping, first = kept(checkpoint, StepState(vector, 1e-3, 0))
    advance(min(first, steps))
    for step in range(first, steps):
        held = slope(level, vector, data, cells)
        with torch.no_grad():
            found = matrix(level, vector, data, cells, held, size, seed * 4096 + step)
            diagonal = torch.diag(found.diagonal() + 1e-9 * found.diagonal().max())
            while damping < LARGEST:
                tried = vector.clone()
                tried[level.places] -= torch.linalg.solve(found + damping * diagonal, held.slope).to(vector.dtype)
                if value(level, tried, data, cells, held) < held.value:
                    vector, damping = tried, max(damping / 4, SMALLEST)
                    break
                damping *= 5
        damping = min(damping, 1.0)
        StepState(vector, damping, step + 1).keep(checkpoint)
        advance(1)
    return vector


def parts_of(cells: Cells) -> list[Cells]:
    """Some cells at a time."""
    step = max(CHUNK // cells.points, 1)
    return [cells.part(k, min(step, len(cells.lost) - k)) for k in range(0, len(cells.lost), step)]


def slope(level: Level, vector: Tensor, data: Data, cells: Cells) -> Held:
    """Of all rows and energies; energies that are far off pull like their size, not like its square."""
    vector = vector.clone().requires_grad_(True)
    total, rows, energies, values = 0.0, [], [], []
    for x, f, floor, lobe in zip(*(v.split(CHUNK) for v in data), strict=True):
        g = level.value(vector, x)
        seen = g.detach()
        values.append(seen)
        rows.append(row_weights(seen, floor, lobe) / len(data.f))
        loss = (rows[-1] * (g - f) ** 2).sum()
        loss.backward()
        total += float(loss.detach())
    for part in parts_of(cells):
        off = part.energies(level.value(vector, part.inputs)) - part.lost
        energies.append(energy_weights(off.detach()) / len(cells.lost))
        loss = (energies[-1] * off**2).sum()
        loss.backward()
        total += float(loss.detach())
    assert vector.grad is not None
    half = 0.5 * vector.grad[level.places].double()
    return Held(total, half, torch.cat(rows), torch.cat([cells.lost[:0], *energies]), torch.cat(values))


def value(level: Level, vector: Tensor, data: Data, cells: Cells, held: Held) -> float:
    """The objective with the weights of a step."""
    total = 0.0
    for x, f, w in zip(data.inputs.split(CHUNK), data.f.split(CHUNK), held.rows.split(CHUNK), strict=True):
        total += float((w * (level.value(vector, x) - f) ** 2).sum())
    at = 0
    for part in parts_of(cells):
        weight = held.energies[at : at + len(part.lost)]
        total += float((weight * (part.energies(level.value(vector, part.inputs)) - part.lost) ** 2).sum())
        at += len(part.lost)
    return total


def matrix(level: Level, vector: Tensor, data: Data, cells: Cells, held: Held, size: int, seed: int) -> Tensor:
    """JᵀJ, float64, of `size` rows, and of every energy as a sum over POINTS of its directions; both drawn anew.

    Rows are drawn in proportion to what they add: few of them carry most of the matrix.
    """
    generator, n = generator_for(seed), len(level.places)
    found = torch.zeros(n, n, dtype=torch.float64)
    below = (held.rows * held.g * held.g).cumsum(0, dtype=torch.float64)
    u = draw((size,), 1, 1, generator=generator, dtype=torch.float64).flatten()
    for some in torch.searchsorted(below, u * below[-1]).clamp_max(len(below) - 1).split(MATRIX):
        _, columns = level.derivatives(vector, Inputs(*(x[some] for x in data.inputs)))
        found += (columns.T @ columns).double() * (below[-1] / size)
    points = min(POINTS, cells.points)
    begin = points * int(integers(0, cells.points // points, (), generator))
    share = cells.points / points
    at = torch.arange(len(cells.lost))[:, None] * cells.points + torch.arange(begin, begin + points)
    for some, weight in zip(at.split(MATRIX // points), held.energies.split(MATRIX // points), strict=True):
        rows = some.flatten()
        g, columns = level.derivatives(vector, Inputs(*(x[rows] for x in cells.inputs)))
        summed = torch.bmm((g * cells.weights[rows] * share).view(-1, 1, points), columns.view(-1, points, n))[:, 0]
        summed *= weight.sqrt()[:, None]
        found += (summed.T @ summed).double()
    return found
