"""Lobes of glass against light: reflected and transmitted, each a row of its own, with energies of however narrow lobes."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.approximations.distil import glass_rows
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.microsurface.distil import glass, held_out
from torchms.sampling.uniforms import generator_for

FROM, LEAVES = ("outside", "inside"), ("reflected", "transmitted")
BELOW = torch.tensor([1.0, 1.0, -1.0])
POINTS = 1 << 15
"""Directions out over which an energy is summed."""

Orders = Callable[[held_out.Cell, Tensor], Tensor]
"""|f cos θ_o| [1/sr] (n, ORDERS) of a direction of incidence, at wo (n, 3)."""


def rows(
    cells: Sequence[held_out.Cell],
    alphas: Sequence[tuple[float, float]],
    light: Tensor,
    models: dict[str, Orders],
    eta: float,
    side: str,
) -> list[dict[str, Any]]:
    """`held_out.summary` of what is reflected and transmitted, in turn, of each of the cells.

    alphas: roughness of each cell's surface. light: `held_out.shares` of both sides. eta: relative index of the other side.
    side: where the light comes from.
    """
    twice = [cell for cell in cells for _ in LEAVES]
    found = held_out.summary(twice, light, {name: shares(orders, cells) for name, orders in models.items()})
    for n, (cell, row) in enumerate(zip(twice, found, strict=True)):
        row |= {"eta": eta, "from": side, "leaves": LEAVES[n % 2]}
        for name, orders in models.items():
            row[name]["energy"] = energies(orders, cell, alphas[n // 2], eta, n % 2 == 0).tolist()
    return found


def shares(orders: Orders, cells: Sequence[held_out.Cell]) -> Tensor:
    """`held_out.integrated` of what is reflected and of what is transmitted, in turn."""
    reflected = held_out.integrated(orders, cells)
    return torch.stack([reflected, held_out.integrated(lambda c, wo: orders(c, wo * BELOW), cells)], 1).flatten(0, 1)


def energies(orders: Orders, cell: held_out.Cell, alpha: tuple[float, float], eta: float, above: bool) -> Tensor:
    """∫ |f cos θ_o| dω_o (ORDERS) on one side, over directions near Smith's lobe: it may be narrower than any cell."""
    ax, ay, index = (torch.tensor([x]) for x in (*alpha, eta))
    where = Surfaces(ax, ay, index, incident(cell, torch.zeros(1, 3)))
    wo, weights = glass_rows.lobes(glass.KIND, where, above, POINTS, generator_for(1))
    return (orders(cell, wo[0]) * weights[0, :, None]).double().sum(0)


def incident(cell: held_out.Cell, wo: Tensor) -> Tensor:
    """The direction of incidence, for each of wo."""
    return torch.from_numpy(cell.wi).float().expand_as(wo)
