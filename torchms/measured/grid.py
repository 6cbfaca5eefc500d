"""Functions on the unit square as grids, bilinear between their nodes, and linear in the parameters of a stack of them."""

import torch
from torch import Tensor, nn


def cell(x: Tensor, n: int) -> tuple[Tensor, Tensor]:
    """Node below x in [0, 1] on a grid of `n` nodes, and the way from it to the next, in [0, 1]."""
    scaled = x.clamp(0, 1) * (n - 1)
    low = scaled.detach().nan_to_num(0).floor().clamp(0, max(n - 2, 0))
    return low.to(torch.int64), scaled - low


class Stack:
    """Weights of two neighbouring grids of a stack: where a parameter falls between the `positions` of the grids.

    A parameter beyond the ends takes the last grid.
    """

    def __init__(self, positions: Tensor, value: Tensor) -> None:
        n = len(positions)
        self.low = (torch.searchsorted(positions, value.detach().contiguous(), right=True) - 1).clamp(0, max(n - 2, 0))
        self.high = (self.low + 1).clamp_max(n - 1)
        step = positions[self.high] - positions[self.low]
        way = (value - positions[self.low]) / torch.where(step > 0, step, 1.0)
        self.way = way.clamp(0, 1)

    def mix(self, take_low: Tensor, take_high: Tensor) -> Tensor:
        """What is between the two."""
        return take_low + self.way * (take_high - take_low)


def bilinear(grid: Tensor, x: Tensor, y: Tensor, stack: Stack | None = None) -> Tensor:
    """`grid` (…, H, W), of stack index (S, …, H, W) if there is one, at (x, y) in the unit square: (…, *batch)."""
    rows, columns = grid.shape[-2:]
    i, fx = cell(x, columns)
    j, fy = cell(y, rows)
    right, below = (i + 1).clamp_max(columns - 1), (j + 1).clamp_max(rows - 1)

    def corner(row: Tensor, column: Tensor) -> Tensor:
        return taken(grid, (row, column), stack)

    top = corner(j, i) * (1 - fx) + corner(j, right) * fx
    return top * (1 - fy) + (corner(below, i) * (1 - fx) + corner(below, right) * fx) * fy


def taken(grid: Tensor, index: tuple[Tensor, ...], stack: Stack | None) -> Tensor:
    """Elements of the last axes of `grid`, mixed along its first if there is a `stack`."""
    if stack is None:
        return grid[(..., *index)]
    return stack.mix(*(grid.movedim(0, -1 - len(index))[(..., which, *index)] for which in (stack.low, stack.high)))


class Density(nn.Module):
    """A stack of densities on the unit square (S, H, W), bilinear; `square` is what makes each of them uniform.

    The second coordinate by its marginal, then the first by its conditional distribution function, both exact integrals of
    the interpolant.
    """

    values: Tensor
    across: Tensor
    """Integral of each row up to each node."""
    down: Tensor
    """Integral of the rows up to each row."""

    def __init__(self, values: Tensor) -> None:
        super().__init__()
        across = _running(values.double())
        down = _running(across[..., -1])
        # Every grid of the stack is a density of its own before two are mixed.
        total = down[..., -1:]
        self.register_buffer("values", (values / total[..., None]).to(values.dtype))
        self.register_buffer("across", (across / total[..., None]).to(values.dtype))
        self.register_buffer("down", (down / total).to(values.dtype))

    def square(self, x: Tensor, y: Tensor, stack: Stack) -> tuple[Tensor, Tensor]:
        """Where (x, y) goes, each in [0, 1]."""
        rows, columns = self.values.shape[-2:]
        i, fx = cell(x, columns)
        j, fy = cell(y, rows)
        row = [taken(self.across[..., -1], (j + k,), stack) for k in (0, 1)]
        v = taken(self.down, (j,), stack) + fy * (row[0] + 0.5 * fy * (row[1] - row[0]))

        def along(table: Tensor, column: Tensor) -> Tensor:
            upper, lower = (taken(table, (j + k, column), stack) for k in (0, 1))
            return upper + fy * (lower - upper)

        left, right = along(self.values, i), along(self.values, i + 1)
        u = along(self.across, i) + fx * (left + 0.5 * fx * (right - left))
        width = row[0] + fy * (row[1] - row[0])
        return (u / torch.where(width > 0, width, 1.0)).clamp(0, 1), v.clamp(0, 1)


def _running(x: Tensor) -> Tensor:
    """Integral from the first node to each along the last axis, by the trapezium rule, in steps of one."""
    half = 0.5 * (x[..., 1:] + x[..., :-1])
    return torch.cat([torch.zeros_like(x[..., :1]), half.cumsum(-1)], -1)
