"""The end of a training: Levenberg–Marquardt steps on the sum of all orders, then the other outputs anew.

For a few hundred numbers a step costs as much as a hundred of Adam's, and gets several times closer to the data.
"""

import io
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.distil.energies import POINTS, Cells
from torchms.approximations.distil.training import BATCH, ENERGY, loss
from torchms.approximations.distil.weights import Weights
from torchms.approximations.metal_lobes import EXPONENT
from torchms.approximations.network import soft_sign
from torchms.sampling.uniforms import generator_for, integers
from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

ROWS = 98304
"""Rows of a step, drawn anew every REDRAWN steps."""
CELLS = 96
REDRAWN = 5
CHUNK = 16384
SMALLEST, LARGEST = 1e-8, 1e4
"""Range of the damping."""


class Data(NamedTuple):
    """Standardised features (n, FEATURES), sums of the orders from 2 on (n) and floors (n) [1/sr]."""

    inputs: Tensor
    f: Tensor
    floor: Tensor

    def part(self, first: int, count: int) -> "Data":
        """`count` rows."""
        return Data(*(x[first : first + count] for x in self))


class Level:
    """ln g of the network and its derivatives by the numbers that it depends on."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        sizes = weights.sizes
        places, at = [], 0
        for n, m in pairwise(sizes[:-1]):
            places.append(torch.arange(at, at + m * n + m))
            at += m * n + m
        n, m = sizes[-2:]
        # Of the last layer: the first row, and its offset; then the linear part.
        places += [torch.arange(at, at + n), torch.tensor([at + m * n])]
        places.append(torch.arange(at + m * n + m, at + m * n + m + sizes[0]))
        self.places = torch.cat(places)

    def value(self, vector: Tensor, inputs: Tensor) -> Tensor:
        """g (n)."""
        return torch.exp(self.weights.outputs(vector, inputs)[:, 0].clamp(*EXPONENT))

    def derivatives(self, vector: Tensor, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """g (n) and d ln g / d vector (n, len(places))."""
        layers, skip = self.weights.split(vector)
        x, seen, slopes = inputs, [], []
        for weight, offset in layers[:-1]:
            z = torch.addmm(offset, x, weight.T)
            inverse = 1 / (1 + z.abs())
            seen.append(x)
            slopes.append(inverse * inverse)
            x = z * inverse
        weight, offset = layers[-1]
        level = x @ weight[0] + offset[0] + inputs @ skip
        columns = [inputs, torch.ones_like(level)[:, None], x]
        back = weight[0].expand_as(x)
        for k in range(len(layers) - 2, -1, -1):
            back = back * slopes[k]
            columns.append(back)
            columns.append((back[:, :, None] * seen[k][:, None, :]).flatten(1))
            back = back @ layers[k][0]
        return torch.exp(level.clamp(*EXPONENT)), torch.cat(columns[::-1], 1)


def refined(
    weights: Weights,
    vector: Tensor,
    data: Data,
    cells: Cells,
    steps: int,
    seed: int,
    checkpoint: Path,
    advance: Callable[[int], None],
) -> Tensor:
    """`vector` after `steps` damped Gauss–Newton steps on relative squares and energies.

    A step that ends a set of rows is kept in `checkpoint`, and gone on from: more steps may be asked for later.
    """
    level, generator = Level(weights), generator_for(seed)
    damping, rows, some, held = 1e-2, data, cells, data.f
    least, first = 0.0, 0
    if checkpoint.exists():
        kept = read_arrays(checkpoint, 1 << 24)
        first = min(int(kept["step"]), steps - steps % REDRAWN)
        if first == int(kept["step"]):
            vector, damping = torch.from_numpy(kept["vector"]), float(kept["damping"])
        else:
            first = 0
    for _ in range(2 * (first // REDRAWN)):
        integers(0, 2, (), generator)
    advance(first)
    for step in range(first, steps):
        if step % REDRAWN == 0:
            count, number = min(ROWS, len(data.f)), min(CELLS, len(cells.lost))
            rows = data.part(int(integers(0, len(data.f) - count + 1, (), generator)), count)
            some = cells.part(int(integers(0, len(cells.lost) - number + 1, (), generator)), number)
            held = torch.cat([level.value(vector, x) for x in rows.inputs.split(CHUNK)])
            held = 1 / (held * held + rows.floor * rows.floor) / count
            least = _objective(level, vector, rows, some, held)
        matrix, slope = _normal_equations(level, vector, rows, some, held)
        diagonal = matrix.diagonal() + 1e-9 * matrix.diagonal().max()
        while damping < LARGEST:
            move = torch.linalg.solve(matrix + damping * torch.diag(diagonal), -slope)
            tried = vector.clone()
            tried[level.places] += move.to(vector.dtype)
            found = _objective(level, tried, rows, some, held)
            if found < least:
                vector, least, damping = tried, found, max(damping / 4, SMALLEST)
                break
            damping *= 5
        damping = min(damping, 1.0)
        advance(1)
        if (step + 1) % REDRAWN == 0:
            file = io.BytesIO()
            np.savez(file, step=np.array(step + 1), vector=vector.numpy(), damping=np.array(damping))
            write_whole(checkpoint, file.getvalue(), force=True)
    return vector


def _objective(level: Level, vector: Tensor, rows: Data, cells: Cells, weight: Tensor) -> float:
    total = 0.0
    for x, f, w in zip(*(t.split(CHUNK) for t in (rows.inputs, rows.f, weight)), strict=True):
        total += float((w * (level.value(vector, x) - f) ** 2).sum(dtype=torch.float64))
    g = torch.cat([level.value(vector, x) for x in cells.inputs.split(CHUNK)])
    return total + ENERGY * float(((cells.energies(g) - cells.lost) ** 2).mean(dtype=torch.float64))


def _normal_equations(level: Level, vector: Tensor, rows: Data, cells: Cells, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Matrix and slope of the squares' linearisation, float64."""
    n = len(level.places)
    matrix, slope = torch.zeros(n, n, dtype=torch.float64), torch.zeros(n, dtype=torch.float64)

    def add(jacobian: Tensor, residual: Tensor) -> None:
        matrix.add_((jacobian.T @ jacobian).double())
        slope.add_((jacobian.T @ residual).double())

    for x, f, w in zip(*(t.split(CHUNK) for t in (rows.inputs, rows.f, weight)), strict=True):
        g, derivatives = level.derivatives(vector, x)
        root = w.sqrt()
        add(derivatives * (root * g)[:, None], root * (g - f))
    factor = (ENERGY / len(cells.lost)) ** 0.5
    for part in _in_parts(cells):
        g, derivatives = level.derivatives(vector, part.inputs)
        summed = torch.bmm((g * part.weights).reshape(-1, 1, POINTS), derivatives.reshape(-1, POINTS, n))[:, 0]
        add(factor * summed, factor * (part.energies(g) - part.lost))
    return matrix, slope


def _in_parts(cells: Cells) -> Iterator[Cells]:
    step = CHUNK // POINTS
    for first in range(0, len(cells.lost), step):
        yield cells.part(first, min(step, len(cells.lost) - first))


def others_anew(
    weights: Weights, vector: Tensor, data: Data, targets: Tensor, steps: int, seed: int, advance: Callable[[int], None]
) -> Tensor:
    """`vector` with the last layer's rows of all outputs but the first fitted again, by Adam; ln g stays."""
    layers, skip = weights.split(vector)
    weight, offset = layers[-1]
    rows, shifts = weight[1:].clone().requires_grad_(True), offset[1:].clone().requires_grad_(True)
    with torch.no_grad():
        parts = []
        for x in data.inputs.split(CHUNK):
            hidden = x
            for w, b in layers[:-1]:
                hidden = soft_sign(torch.addmm(b, hidden, w.T))
            parts.append(torch.cat([hidden, (hidden @ weight[0] + offset[0] + x @ skip)[:, None]], 1))
        hidden = torch.cat(parts)
    starts = integers(0, len(hidden) - BATCH + 1, (steps,), generator_for(seed))
    optimizer = torch.optim.Adam([rows, shifts], lr=1e-2)
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = 1e-2 * (1 - step / steps) + 1e-5
        here = slice(int(starts[step]), int(starts[step]) + BATCH)
        x = hidden[here]
        outputs = torch.cat([x[:, -1:], torch.addmm(shifts, x[:, :-1], rows.T)], 1)
        optimizer.zero_grad(set_to_none=True)
        loss(outputs, targets[here], data.floor[here]).backward()
        optimizer.step()
        advance(1)
    found = vector.clone()
    weight, offset = weights.split(found)[0][-1]
    with torch.no_grad():
        weight[1:], offset[1:] = rows, shifts
    return found
