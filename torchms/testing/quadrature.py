"""Integrals over the sphere of functions with narrow peaks and edges."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

ORDER = 6
CHUNK = 1 << 14
"""Directions at once: what a quadrature inside of `function` makes of them should stay in the cache."""


def sphere_cells(
    function: Callable[[Tensor], Tensor],
    bins: tuple[int, int] = (32, 32),
    tolerance: float = 1e-4,
    levels: int = 16,
) -> Tensor:
    """Integrals of `function` (n, 3) → (n,) over the cells of the sphere, `bins` = (n_cos, n_phi), in float64.

    Gauss–Legendre in (θ, φ) on cells that are halved both ways wherever that changes their integral by more than their
    share of `tolerance`, the error that is aimed at in the sum. A peak far narrower than a sixth of a cell may be missed.
    Raises ValueError for bins or a tolerance that are not positive, or if `function` gives another shape.
    """
    if len(bins) != 2 or not all(isinstance(n, int) and n > 0 for n in bins):
        raise ValueError(f"bins must be two positive integers (n_cos, n_phi); got {bins!r}.")
    if not tolerance > 0:
        raise ValueError(f"tolerance must be positive; got {tolerance}.")
    n_cos, n_phi = bins
    theta = torch.acos(torch.linspace(-1, 1, n_cos + 1, dtype=torch.float64).clamp(-1, 1))
    phi = torch.linspace(0, 2 * torch.pi, n_phi + 1, dtype=torch.float64)
    rows, columns = torch.meshgrid(torch.arange(n_cos), torch.arange(n_phi), indexing="ij")
    rows, columns = rows.reshape(-1), columns.reshape(-1)
    boxes = torch.stack([theta[rows + 1], theta[rows], phi[columns], phi[columns + 1]], -1)
    owner = rows * n_phi + columns
    result = torch.zeros(n_cos * n_phi, dtype=torch.float64)
    coarse = _integrals(function, boxes)
    for level in range(levels):
        quarters = _quartered(boxes)
        fine = _integrals(function, quarters).reshape(-1, 4)
        # A cell's own error is not known; half of the tolerance is spread evenly over all cells of a level.
        rough = (fine.sum(1) - coarse).abs() > 0.5 * tolerance / len(boxes)
        if level == levels - 1:
            rough = torch.zeros_like(rough)
        result.index_add_(0, owner[~rough], fine[~rough].sum(1))
        if not bool(rough.any()):
            break
        boxes = quarters.reshape(-1, 4, 4)[rough].reshape(-1, 4)
        coarse = fine[rough].reshape(-1)
        owner = owner[rough].repeat_interleave(4)
    return result.reshape(n_cos, n_phi)


def _quartered(boxes: Tensor) -> Tensor:
    a, b, c, d = boxes.unbind(-1)
    m, n = (a + b) / 2, (c + d) / 2
    parts = [(a, m, c, n), (a, m, n, d), (m, b, c, n), (m, b, n, d)]
    return torch.stack([torch.stack(part, -1) for part in parts], 1).reshape(-1, 4)


def _integrals(function: Callable[[Tensor], Tensor], boxes: Tensor) -> Tensor:
    """∫ function sin θ dθ dφ over each (θ_0, θ_1, φ_0, φ_1)."""
    nodes, weights = (torch.from_numpy(x) for x in np.polynomial.legendre.leggauss(ORDER))
    return torch.cat([_chunk(function, part, nodes, weights) for part in boxes.split(CHUNK // ORDER**2)])


def _chunk(function: Callable[[Tensor], Tensor], boxes: Tensor, nodes: Tensor, weights: Tensor) -> Tensor:
    a, b, c, d = (x[:, None] for x in boxes.unbind(-1))
    theta = (a + b) / 2 + (b - a) / 2 * nodes
    phi = (c + d) / 2 + (d - c) / 2 * nodes
    sin, cos = theta.sin()[:, :, None], theta.cos()[:, :, None]
    w = torch.stack(torch.broadcast_tensors(sin * phi.cos()[:, None, :], sin * phi.sin()[:, None, :], cos), -1)
    w = w.reshape(-1, 3)
    values = function(w)
    if not isinstance(values, Tensor) or values.shape != w.shape[:1]:
        found = tuple(values.shape) if isinstance(values, Tensor) else type(values).__name__
        raise ValueError(f"the function of directions (n, 3) must give a Tensor (n,), n = {len(w)} here; got {found}.")
    values = values.double().reshape(len(boxes), ORDER, ORDER) * sin
    return ((b - a) * (d - c) / 4)[:, 0] * torch.einsum("bij,i,j->b", values, weights, weights)
