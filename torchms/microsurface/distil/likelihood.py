"""Lobes that make simulated light most likely, without bins: damped Newton steps on the likelihood of where paths left.

Paths leave as a Poisson process of density λ_k = f_k cos θ_o. With λ_k = (Smith's) · exp c_k the mean over all directions
of incidence of

    Σ_k ∫ λ_k dω_o − Σ_paths c_k(wi, wo) / N

is smallest where λ is the surface's. The integral is a sum over fixed points; its curvature, ∫ λ ∇c ∇cᵀ, is the matrix.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.step_state import StepState, kept
from torchms.approximations.distil.weights import Inputs
from torchms.microsurface.distil.networks import Correction
from torchms.sampling.uniforms import draw, generator_for, integers

CHUNK = 8192
POINTS = 1 << 15
"""Points of the integral that the matrix of a step is made from."""
LOOKS = ((0.5, 1 / 8), (0.8, 1 / 2), (1.0, 1.0))
"""Up to which share of the steps a step looks at which share of the directions; others in each."""
TRIES = 6
SMALLEST = 1e-6


class Paths(NamedTuple):
    """Standardised features of paths, direction by direction; index of their order (n); weights that sum to their energy.

    first: (m + 1) where the paths of each direction begin.
    """

    inputs: Inputs
    order: Tensor
    weight: Tensor
    first: Tensor

    def part(self, begin: int, end: int) -> "Paths":
        """Those of the directions `begin` … `end` − 1, with the weights of all."""
        rows = slice(int(self.first[begin]), int(self.first[end]))
        more = (len(self.first) - 1) / (end - begin)
        return Paths(self.inputs.part(rows), self.order[rows], self.weight[rows] * more, self.first)


class Points(NamedTuple):
    """Standardised features where the integral is summed, `each` a direction; Smith's λ_k times their shares (n, ORDERS)."""

    inputs: Inputs
    smith: Tensor
    each: int

    def part(self, begin: int, end: int) -> "Points":
        """Those of the directions `begin` … `end` − 1, with the shares of all."""
        rows = slice(begin * self.each, end * self.each)
        more = len(self.smith) / (self.each * (end - begin))
        return Points(self.inputs.part(rows), self.smith[rows] * more, self.each)


def turn(length: int, share: float, step: int) -> tuple[int, int]:
    """Which `share` of `length` directions a step looks at."""
    count = max(1, round(length * share))
    begin = (step % (length // count)) * count
    return begin, begin + count


def value(model: Correction, vector: Tensor, paths: Paths, points: Points) -> float:
    """The negative likelihood."""
    with torch.no_grad():
        return float(sum(_terms(model, vector, paths, points)))


def slope(model: Correction, vector: Tensor, paths: Paths, points: Points) -> tuple[float, Tensor]:
    """The negative likelihood and its gradient."""
    vector = vector.clone().requires_grad_(True)
    total = 0.0
    for term in _terms(model, vector, paths, points):
        term.backward()
        total += float(term.detach())
    assert vector.grad is not None
    return total, vector.grad


def _terms(model: Correction, vector: Tensor, paths: Paths, points: Points) -> Iterator[Tensor]:
    for x, index, weight in zip(
        paths.inputs.split(CHUNK), paths.order.split(CHUNK), paths.weight.split(CHUNK), strict=True
    ):
        yield -(weight * model.outputs(vector, x).gather(1, index[:, None])[:, 0]).sum()
    for x, smith in zip(points.inputs.split(CHUNK), points.smith.split(CHUNK), strict=True):
        yield (smith * torch.exp(model.outputs(vector, x))).sum()


@torch.no_grad()
def matrix(model: Correction, vector: Tensor, points: Points, seed: int) -> Tensor:
    """∫ λ ∇c ∇cᵀ, float64, at points of which each speaks for one order, drawn in proportion to λ_k."""
    generator = generator_for(seed)
    rows = integers(0, len(points.smith), (POINTS,), generator)
    found = torch.zeros(len(vector), len(vector), dtype=torch.float64)
    for some in rows.split(CHUNK):
        x = Inputs(*(a[some] for a in points.inputs))
        share = points.smith[some] * torch.exp(model.outputs(vector, x)) + 1e-30
        u = draw((len(some),), 1, 1, generator=generator)[:, 0]
        which = (share.cumsum(1) < u * share.sum(1, keepdim=True)).sum(1).clamp_max(share.shape[1] - 1)
        root = (share.sum(1) * (len(points.smith) / POINTS)).sqrt()
        columns = model.derivatives(vector, x, which) * root[:, None]
        found += (columns.T @ columns).double()
    return found


def fitted(
    model: Correction,
    vector: Tensor,
    paths: Paths,
    points: Points,
    steps: int,
    seed: int,
    checkpoint: Path,
    advance: Callable[[int], None],
) -> Tensor:
    """`vector` after `steps` steps; every step is kept in `checkpoint`, and gone on from."""
    vector, damping, first = kept(checkpoint, StepState(vector, 0.1, 0))
    advance(min(first, steps))
    for step in range(first, steps):
        share = next(share for until, share in LOOKS if step < until * steps)
        begin, end = turn(len(paths.first) - 1, share, step)
        some, where = paths.part(begin, end), points.part(begin, end)
        least, gradient = slope(model, vector, some, where)
        curved = matrix(model, vector, points, seed + step)
        diagonal = torch.diag(curved.diagonal() + 1e-7 * curved.diagonal().max())
        for _ in range(TRIES):
            tried = vector - torch.linalg.solve(curved + damping * diagonal, gradient.double()).float()
            if value(model, tried, some, where) < least:
                vector, damping = tried, max(damping / 4, SMALLEST)
                break
            damping *= 5
        damping = min(damping, 1e3)
        StepState(vector, damping, step + 1).keep(checkpoint)
        advance(1)
    return vector
