"""The end of a training: Levenberg–Marquardt steps on the sum of all orders, then the other outputs anew.

For a few hundred numbers a step costs as much as a hundred of Adam's, and gets several times closer to the data.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.energies import Cells
from torchms.approximations.distil.level import Level
from torchms.approximations.distil.rows import OUTGOING
from torchms.approximations.distil.step_state import StepState, kept
from torchms.approximations.distil.training import loss
from torchms.approximations.distil.weights import Inputs, Net, Weights
from torchms.sampling.uniforms import generator_for, integers

ROWS = 1 << 18
"""Rows of a step."""
CELLS = 128
REDRAWN = 4
LAST, MORE = 0.1, 4
"""Share of the steps, at the end, that look at MORE times as many rows and cells."""
CHUNK = 16384
LOBE, RELATIVE, ENERGY = 10.0, 0.15, 100.0
"""Weights of relative squares of lobes, of relative squares of values, and of squares of energies."""
OTHERS = 1 << 19
"""Rows that the other outputs are fitted to."""
FAR = 4e-3
"""Errors of energies from which on they do not count as squares."""
SMALLEST, LARGEST = 1e-8, 1e4
"""Range of the damping."""


class Data(NamedTuple):
    """Standardised features, sums of the orders from 2 on (n), floors (n) [1/sr], and shares of the squares of lobes (n)."""

    inputs: Inputs
    f: Tensor
    floor: Tensor
    lobe: Tensor

    def part(self, first: int, count: int) -> "Data":
        """`count` rows."""
        rows = slice(first, first + count)
        return Data(self.inputs.part(rows), *(x[rows] for x in self[1:]))


def shares(lobe: Tensor, f: Tensor) -> Tensor:
    """cos² θ_o / density over the mean of that times f², of each direction of incidence: relative squares of lobes (n).

    f: of all orders.
    """
    size = (lobe * f * f).view(-1, OUTGOING).mean(1).repeat_interleave(OUTGOING)
    # Beyond total reflection a lobe may be next to nothing: relative to that, any error would be without bound.
    found = torch.where(size > 1e-6 * size.median(), lobe / size.clamp_min(1e-30), 0.0)
    # A few directions that are hardly ever sampled would decide.
    return found.clamp_max(found.kthvalue(max(1, int(0.9995 * len(found)))).values)


def refined(
    weights: Weights,
    vector: Tensor,
    data: Data,
    cells: Cells,
    steps: int,
    seed: int,
    checkpoint: Path,
    advance: Callable[[int], None],
    size: int = ROWS,
) -> Tensor:
    """`vector` after `steps` damped Gauss–Newton steps on relative squares and energies.

    size: rows of a step, drawn anew every REDRAWN steps. A step that ends a set of rows is kept in `checkpoint`, and gone on
    from: more steps may be asked for later.
    """
    level, generator = Level(weights), generator_for(seed)
    damping, rows, some, held, hard = 1e-2, data, cells, data.f, cells.lost
    least, first = 0.0, 0
    before = kept(checkpoint, StepState(vector, damping, 0))
    if before.step <= steps - steps % REDRAWN:
        vector, damping, first = before
    for _ in range(2 * (first // REDRAWN)):
        integers(0, 2, (), generator)
    advance(first)
    for step in range(first, steps):
        if step % REDRAWN == 0:
            more = MORE if step >= (1 - LAST) * steps else 1
            count, number = min(more * size, len(data.f)), min(more * CELLS, len(cells.lost))
            rows = data.part(int(integers(0, len(data.f) - count + 1, (), generator)), count)
            some = cells.part(int(integers(0, len(cells.lost) - number + 1, (), generator)), number)
            held, hard = _held(level, vector, rows, some)
            least = _objective(level, vector, rows, some, held, hard)
        matrix, slope = _normal_equations(level, vector, rows, some, held, hard)
        diagonal = matrix.diagonal() + 1e-9 * matrix.diagonal().max()
        while damping < LARGEST:
            move = torch.linalg.solve(matrix + damping * torch.diag(diagonal), -slope)
            tried = vector.clone()
            tried[level.places] += move.to(vector.dtype)
            found = _objective(level, tried, rows, some, held, hard)
            if found < least:
                vector, least, damping = tried, found, max(damping / 4, SMALLEST)
                break
            damping *= 5
        damping = min(damping, 1.0)
        advance(1)
        if (step + 1) % REDRAWN == 0:
            StepState(vector, damping, step + 1).keep(checkpoint)
    return vector


def row_weights(g: Tensor, floor: Tensor, lobe: Tensor) -> Tensor:
    """Of squares of errors of g: part relative to the lobe, part to g itself."""
    return LOBE * lobe + RELATIVE / (g * g + floor * floor)


def energy_weights(off: Tensor) -> Tensor:
    """Of squares of `off`, the errors of energies: those far off pull like their size, not like its square."""
    return ENERGY / (1 + off.abs() / FAR)


def _held(level: Level, vector: Tensor, rows: Data, cells: Cells) -> tuple[Tensor, Tensor]:
    """Weights of the rows, and of the energies: those far off pull like their size, not like its square."""
    g = torch.cat([level.value(vector, x) for x in rows.inputs.split(CHUNK)])
    off = energies(level, vector, cells) - cells.lost
    return row_weights(g, rows.floor, rows.lobe) / len(g), energy_weights(off) / max(len(off), 1)


def energies(level: Level, vector: Tensor, cells: Cells) -> Tensor:
    """What leaves by this level in each cell."""
    return cells.energies(torch.cat([level.value(vector, x) for x in cells.inputs.split(CHUNK)]))


def _chunks(rows: Data, weight: Tensor) -> Iterator[tuple[Inputs, Tensor, Tensor]]:
    return zip(rows.inputs.split(CHUNK), rows.f.split(CHUNK), weight.split(CHUNK), strict=True)


def _objective(level: Level, vector: Tensor, rows: Data, cells: Cells, weight: Tensor, hard: Tensor) -> float:
    total = 0.0
    for x, f, w in _chunks(rows, weight):
        total += float((w * (level.value(vector, x) - f) ** 2).sum(dtype=torch.float64))
    return total + float((hard * (energies(level, vector, cells) - cells.lost) ** 2).sum(dtype=torch.float64))


def _normal_equations(
    level: Level, vector: Tensor, rows: Data, cells: Cells, weight: Tensor, hard: Tensor
) -> tuple[Tensor, Tensor]:
    """Matrix and slope of the squares' linearisation, float64."""
    n = len(level.places)
    matrix, slope = torch.zeros(n, n, dtype=torch.float64), torch.zeros(n, dtype=torch.float64)

    def add(jacobian: Tensor, residual: Tensor) -> None:
        matrix.add_((jacobian.T @ jacobian).double())
        slope.add_((jacobian.T @ residual).double())

    for x, f, w in _chunks(rows, weight):
        g, derivatives = level.derivatives(vector, x)
        root = w.sqrt()
        add(derivatives * (root * g)[:, None], root * (g - f))
    for part, factor in _in_parts(cells, hard.sqrt()):
        g, derivatives = level.derivatives(vector, part.inputs)
        each = len(part.lost), cells.points
        summed = torch.bmm((g * part.weights).view(each[0], 1, each[1]), derivatives.view(*each, n))[:, 0]
        add(factor[:, None] * summed, factor * (part.energies(g) - part.lost))
    return matrix, slope


def _in_parts(cells: Cells, factors: Tensor) -> Iterator[tuple[Cells, Tensor]]:
    step = max(CHUNK // cells.points, 1)
    for first in range(0, len(cells.lost), step):
        some = cells.part(first, min(step, len(cells.lost) - first))
        yield some, factors[first : first + len(some.lost)]


def others_anew(
    weights: Weights, vector: Tensor, data: Data, targets: Tensor, steps: int, advance: Callable[[int], None]
) -> Net:
    """Last layer of all n outputs but the first, (n, hidden) and (n), and their linear parts (n, FEATURES), by L-BFGS.

    ln g and the hidden layers, which were refined for it, stay.
    """
    data, targets = data.part(0, min(OTHERS, len(data.f))), targets[:OTHERS]
    layers, _ = weights.split(vector)[0]
    weight, offset = layers[-1]
    with torch.no_grad():
        known = torch.cat([weights.hidden(layers, data.inputs.pair), data.inputs.pair], 1)
        level = torch.cat([weights.outputs(vector, x)[:, :1] for x in data.inputs.split(CHUNK)])
    rows = torch.cat([weight[1:], torch.zeros(len(weight) - 1, data.inputs.pair.shape[1])], 1).requires_grad_(True)
    shifts = offset[1:].clone().requires_grad_(True)
    optimizer = torch.optim.LBFGS([rows, shifts], max_iter=steps, history_size=20, line_search_fn="strong_wolfe")

    def value() -> Tensor:
        optimizer.zero_grad(set_to_none=True)
        found = loss(torch.cat([level, torch.addmm(shifts, known, rows.T)], 1), targets, data.floor)
        found.backward()
        return found

    optimizer.step(value)
    advance(steps)
    last, linear = rows.detach().split([weight.shape[1], data.inputs.pair.shape[1]], 1)
    return [(last, shifts.detach())], linear
