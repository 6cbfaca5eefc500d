"""Energies per order and lobes of a BSDF, by its own random walk."""

import os

import torch
from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.cli.progress import progress_bar
from torchms.evaluation.workers import Workers
from torchms.lobes.tally import Lobes, Tally
from torchms.maths.frame import Vec3, check_direction
from torchms.sampling.uniforms import draw, generator_for
from torchms.typing import Direction

BLOCK_PATHS = 16384
"""Paths that are walked at a time; each block has a random stream of its own, so threads do not change a result."""


@torch.no_grad()
def measure(
    bsdf: BSDF,
    wi: Direction,
    *,
    n_paths: int = 1_000_000,
    seed: int = 0,
    bins: tuple[int, int] | None = None,
    lobe_orders: int = 3,
    progress: bool | None = None,
    threads: int | None = None,
) -> Tally:
    """Share of the energy from `wi` (3,) that leaves after each order, with standard errors; lobes if `bins` is given.

    bins: (n_cos, n_phi) cells over cos θ_o in [−1, 1] and φ_o in [0, 2π), for the orders 1 … `lobe_orders` and for all
    orders together. Energies carry no η² factor. Every parameter of `bsdf` must be a scalar (or one number a channel).
    The result depends on `seed` and `n_paths` only. Raises ValueError if `wi` is not one direction on a side that the
    BSDF serves.
    """
    check_direction(wi, "measure(wi=...)")
    if tuple(wi.shape) != (3,):
        raise ValueError(f"measure(wi=...) must be one direction (3,); got shape {tuple(wi.shape)}.")
    if any(shape.numel() != 1 for shape in bsdf.parameter_batch_shapes()):
        raise ValueError("measure(bsdf=...) must have scalar parameters; got a per-pixel map. Measure one pixel of it.")
    if n_paths < 2:
        raise ValueError(f"measure(n_paths=...) must be at least 2; got {n_paths}.")
    sizes = [min(BLOCK_PATHS, n_paths - start) for start in range(0, n_paths, BLOCK_PATHS)]
    vertex = bsdf.vertex
    view = Vec3(*wi.to(bsdf.dtype).reshape(3, 1, 1).unbind(0))
    if not bool(vertex.enter(view)[2].all()):
        raise ValueError(f"measure(wi=...) must lie above the horizon (wi_z > 0); got {wi.tolist()}.")

    def block(index: int) -> "_Sums":
        generator = generator_for((seed * 1_000_003 + index) % 2**63)
        u = draw((), sizes[index], bsdf.n_uniforms, generator=generator, dtype=bsdf.dtype)
        return _walk_block(bsdf, view, u.permute(1, 0).unsqueeze(-1).unbind(0), sizes[index], bins, lobe_orders)

    sums: _Sums | None = None
    with (
        progress_bar("walks", n_paths, progress) as advance,
        Workers(threads or min(len(sizes), os.cpu_count() or 1)) as workers,
    ):
        for size, part in zip(sizes, workers.map(block, range(len(sizes))), strict=True):
            sums = part if sums is None else sums.plus(part)
            advance(size)
    assert sums is not None
    return sums.tally(n_paths, bins)


class _Sums:
    """Sums over paths of the energies (2, K, C), their total and what remains (C,), their squares, and the lobes'."""

    def __init__(self, *sums: Tensor) -> None:
        self.sums = sums

    def plus(self, other: "_Sums") -> "_Sums":
        return _Sums(*(a + b for a, b in zip(self.sums, other.sums, strict=True)))

    def tally(self, n: int, bins: tuple[int, int] | None) -> Tally:
        pairs = list(zip(self.sums[0::2], self.sums[1::2], strict=True))
        orders, *sums = (_mean_and_error(a, b, n) for a, b in pairs[:3])
        lobes = None
        if bins is not None:
            mean, error = _mean_and_error(*pairs[3], n)
            cell = 4 * torch.pi / (bins[0] * bins[1])
            lobes = Lobes(mean / cell, error / cell)
        return Tally(*orders[0], *orders[1], *(x for pair in sums for x in pair), n=n, lobes=lobes)


def _mean_and_error(total: Tensor, squares: Tensor, n: int) -> tuple[Tensor, Tensor]:
    mean = total / n
    return mean, ((squares / n - mean * mean).clamp_min(0) / (n - 1)).sqrt()


def _walk_block(
    bsdf: BSDF, wi: Vec3, u: tuple[Tensor, ...], size: int, bins: tuple[int, int] | None, lobe_orders: int
) -> _Sums:
    energies: list[Tensor] = []
    squares: list[Tensor] = []
    total: Tensor | None = None
    cells: Tensor | None = None
    left: Tensor | None = None
    weight: Tensor | None = None
    planes = [] if bins is None else [_Plane(bins) for _ in range(lobe_orders + 1)]
    for k, leaving in enumerate(bsdf._walk(wi, u)):
        energy = (leaving.weight * leaving.escapes).to(torch.float64).reshape(-1, size)
        weight = leaving.weight
        total = energy if total is None else total + energy
        left = leaving.escapes if left is None else left + leaving.escapes
        sides = torch.stack([torch.where(leaving.transmitted.reshape(1, -1), 0.0, energy), energy])
        sides[1] -= sides[0]
        energies.append(sides.sum(-1))
        squares.append((sides * sides).sum(-1))
        if bins is not None:
            cells = _cells(leaving.d, bins)
            if k < lobe_orders:
                planes[k].add(cells, energy)
            planes[-1].add(cells, energy)
    assert total is not None and left is not None and weight is not None
    remaining = (weight * (1 - left)).to(torch.float64).reshape(-1, size)
    sums = [torch.stack(energies, 1), torch.stack(squares, 1)]
    for value in (total, remaining):
        sums += [value.sum(-1), (value * value).sum(-1)]
    if cells is not None:
        for plane in planes[len(energies) : -1]:  # orders beyond the last one
            plane.add(cells, torch.zeros_like(total))
        # A path adds to a cell of the last plane at most a few times; its squares are summed bounce by bounce.
        sums += [torch.stack([p.sum for p in planes]), torch.stack([p.squares for p in planes])]
    return _Sums(*sums)


def _cells(d: Vec3, bins: tuple[int, int]) -> Tensor:
    """Index of the cell that each direction falls into, cos θ major."""
    n_cos, n_phi = bins
    row = ((d.z.double() + 1) * (n_cos / 2)).long().clamp(0, n_cos - 1)
    turn = torch.atan2(d.y.double(), d.x.double()) / (2 * torch.pi)
    column = ((turn % 1.0) * n_phi).long().clamp(0, n_phi - 1)
    return (row * n_phi + column).reshape(-1)


class _Plane:
    """A histogram with the sums of its entries and of their squares, (n_cos, n_phi, C)."""

    def __init__(self, bins: tuple[int, int]) -> None:
        self.bins = bins
        self.sum: Tensor = torch.zeros(())
        self.squares: Tensor = torch.zeros(())

    def add(self, cells: Tensor, energy: Tensor) -> None:
        self.sum = self.sum + self._histogram(cells, energy)
        self.squares = self.squares + self._histogram(cells, energy * energy)

    def _histogram(self, cells: Tensor, weights: Tensor) -> Tensor:
        n = self.bins[0] * self.bins[1]
        return torch.stack([torch.bincount(cells, w, minlength=n).reshape(self.bins) for w in weights], -1)
