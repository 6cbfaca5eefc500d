"""Light on surfaces that nothing was learned from, and how far Smith's lobes and learned ones are from it."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.microsurface.rays.grid_walk import GridCaster
from torchms.microsurface.simulation.exits import exits, stretched
from torchms.microsurface.simulation.materials import FacetMaterial, MirrorFacets

ROWS, COLUMNS = 32, 64
"""Cells of a lobe: equal steps of cos θ_o and of φ_o."""
FINER = 8
"""Azimuths in each cell at which a lobe is summed."""
PANEL = 0.012
"""Largest step of θ_o [rad] of the two points of a Gauss rule: lobes of transmitted light may be no wider."""
HALVES = 2
ORDERS = 4
LONGEST = 30


class Cell(NamedTuple):
    """α_x, α_y, and angle and azimuth of incidence [rad]."""

    ax: float
    ay: float
    theta: float
    phi: float

    @property
    def wi(self) -> np.ndarray:
        """Direction of incidence (3,)."""
        s = np.sin(self.theta)
        return np.array([s * np.cos(self.phi), s * np.sin(self.phi), np.cos(self.theta)])


class Errors(NamedTuple):
    """Of each lobe, all orders together: RMS of the difference over the lobe's RMS, noise of the light taken out; that noise.

    Both are 0 where no light was met twice. energy: (cells, ORDERS) difference of the energies of the orders 1, 2, 3 and ≥ 4.
    """

    lobe: Tensor
    noise: Tensor
    energy: Tensor


def shares(
    casters: Sequence[GridCaster] | Callable[[int], GridCaster],
    count: int,
    cells: Sequence[Cell],
    rays: int,
    seed: int,
    advance: Callable[[int], None] = lambda n: None,
    facets: FacetMaterial | None = None,
    sides: int = 1,
) -> Tensor:
    """Share of the light in each cell of the lobe: (HALVES, cells, ORDERS, ROWS, COLUMNS), of even and of odd surfaces.

    sides: 2 for glass, of which each cell has two lobes, one after the other: reflected and transmitted.
    casters: tiles of α = 1, by their number, which are stretched to each cell's roughness. rays: of each tile and cell.
    facets: mirrors if not given.
    """
    found = np.zeros((HALVES, len(cells) * sides, ORDERS, ROWS * COLUMNS))
    for number in range(count):
        caster = casters(number) if callable(casters) else casters[number]
        for k, cell in enumerate(cells):
            wi = np.broadcast_to(cell.wi, (rays, 3))
            key = np.array([seed, number * 4096 + k], dtype=np.uint32)
            left = exits(stretched(caster, cell.ax, cell.ay), facets or MirrorFacets(), wi, key, LONGEST)
            for side in range(sides):
                some = (left.order > 0) & ((left.wo[:, 2] < 0) == (side > 0))
                place = binned(left.wo[some]) + ROWS * COLUMNS * (np.minimum(left.order[some].astype(int), ORDERS) - 1)
                counts = np.bincount(place, minlength=ORDERS * ROWS * COLUMNS).reshape(ORDERS, -1)
                found[number % HALVES, k * sides + side] += counts
        advance(1)
    parts = [rays * len(range(half, count, HALVES)) for half in range(HALVES)]
    found /= np.array(parts).reshape(-1, 1, 1, 1)
    return torch.from_numpy(found).reshape(HALVES, len(cells) * sides, ORDERS, ROWS, COLUMNS)


def binned(wo: np.ndarray) -> np.ndarray:
    """Number of the cell of each direction (n, 3), above or below the horizon."""
    row = np.clip((np.abs(wo[:, 2]) * ROWS).astype(int), 0, ROWS - 1)
    turn = np.arctan2(wo[:, 1], wo[:, 0]) / (2 * np.pi) % 1.0
    return row * COLUMNS + np.clip((turn * COLUMNS).astype(int), 0, COLUMNS - 1)


def integrated(orders: Callable[[Cell, Tensor], Tensor], cells: Sequence[Cell]) -> Tensor:
    """∫ f cos θ_o dω over each cell of the lobes, (cells, ORDERS, ROWS, COLUMNS).

    orders: f cos θ_o [1/sr] (n, ORDERS) of a direction of incidence, at wo (n, 3).
    """
    theta, weight, row = _polar()
    turn = (torch.arange(COLUMNS * FINER, dtype=torch.float64) + 0.5) * (2 * torch.pi / (COLUMNS * FINER))
    around = torch.stack([turn.cos(), turn.sin(), torch.ones_like(turn)], -1)
    up = torch.stack([theta.sin(), theta.sin(), theta.cos()], -1)
    wo = (up[:, None] * around).reshape(-1, 3).float()
    found = []
    for cell in cells:
        value = orders(cell, wo).double().T.reshape(-1, len(theta), COLUMNS, FINER).mean(-1)
        rows = torch.zeros(len(value), ROWS, COLUMNS, dtype=torch.float64)
        found.append(rows.index_add_(1, row, value * weight[:, None]))
    return torch.stack(found)


def _polar() -> tuple[Tensor, Tensor, Tensor]:
    """Angles [rad], what lobes there are multiplied by, and in which row they are: finer where a row is wider, at the pole."""
    edges = torch.acos(torch.linspace(0, 1, ROWS + 1, dtype=torch.float64))
    parts = []
    for row, (high, low) in enumerate(itertools.pairwise(edges)):
        n = max(FINER // 2, math.ceil(float(high - low) / PANEL))
        step = (high - low) / n
        middle = low + (torch.arange(n, dtype=torch.float64) + 0.5) * step
        theta = torch.cat([middle - step / math.sqrt(12), middle + step / math.sqrt(12)])
        parts.append((theta, theta.sin() * step * (math.pi / COLUMNS), torch.full((2 * n,), row)))
    theta, weight, rows = (torch.cat(column) for column in zip(*parts, strict=True))
    return theta, weight, rows


def errors(light: Tensor, model: Tensor) -> Errors:
    """How far `model` (cells, ORDERS, ROWS, COLUMNS) is from `light` (HALVES, …)."""
    a, b = light.sum(2)
    mine = model.sum(1)
    size = (a * b).sum((-2, -1))
    off = ((mine - a) * (mine - b)).sum((-2, -1)).clamp_min(0)
    noise = ((a - b) ** 2).sum((-2, -1)) / 4
    lit = size > 0
    off, noise = (torch.where(lit, (x / torch.where(lit, size, 1.0)).sqrt(), 0.0) for x in (off, noise))
    return Errors(off, noise, (model - light.mean(0)).sum((-2, -1)))


def summary(cells: Sequence[Cell], light: Tensor, models: dict[str, Tensor]) -> list[dict[str, Any]]:
    """One row a cell, JSON-serialisable: energies of the light, of the models, and the lobes' errors."""
    halves = light.sum((-2, -1))
    found = {name: errors(light, model) for name, model in models.items()}
    rows = []
    for k, cell in enumerate(cells):
        row: dict[str, Any] = dict(zip(("alpha_x", "alpha_y", "theta", "phi"), cell, strict=True))
        row["energy"] = halves.mean(0)[k].tolist()
        row["energy_noise"] = ((halves[0] - halves[1]).abs() / 2)[k].tolist()
        for name, model in models.items():
            row[name] = {
                "energy": model.sum((-2, -1))[k].tolist(),
                "lobe_error": float(found[name].lobe[k]),
                "noise": float(found[name].noise[k]),
            }
        rows.append(row)
    return rows
