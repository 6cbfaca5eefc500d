"""Lobes that make simulated light most likely, without bins: Adam's steps on the likelihood of where paths left.

Paths leave as a Poisson process of density λ_k = f_k cos θ_o. With λ_k = (Smith's) · exp c_k the mean over all directions
of incidence of

    Σ_k ∫ λ_k dω_o − Σ_paths c_k(wi, wo) / N

is smallest where λ is the surface's. The integral is a sum over points. Paths of each direction weigh 1 together, as all
light leaves: that the energies of the orders add up to 1 is said by the likelihood itself.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.adam_state import AdamState
from torchms.approximations.distil.weights import Inputs
from torchms.microsurface.distil.networks import Correction

AT_ONCE = 256
"""Directions of incidence that a step looks at."""
RATE, LAST_RATE = 1e-2, 1e-5
URGENT = (1.0, 1.0, 2.0, 4.0)
"""Weights of the orders' likelihoods: the rare ones would hardly be heard."""


class Paths(NamedTuple):
    """Standardised features of paths, direction by direction; index of their order (n); weights that sum to 1 a direction.

    first: (m + 1) where the paths of each direction begin.
    """

    inputs: Inputs
    order: Tensor
    weight: Tensor
    first: Tensor

    def part(self, begin: int, end: int) -> "Paths":
        """Those of the directions `begin` … `end` − 1."""
        rows = slice(int(self.first[begin]), int(self.first[end]))
        return Paths(self.inputs.part(rows), self.order[rows], self.weight[rows], self.first[begin : end + 1])


class Points(NamedTuple):
    """Standardised features where integrals are summed, `each` a direction; Smith's λ_k times their shares (n, ORDERS)."""

    inputs: Inputs
    smith: Tensor
    each: int

    def part(self, begin: int, end: int) -> "Points":
        """Those of the directions `begin` … `end` − 1."""
        rows = slice(begin * self.each, end * self.each)
        return Points(self.inputs.part(rows), self.smith[rows], self.each)


def loss(model: Correction, vector: Tensor, paths: Paths, points: Points) -> Tensor:
    """The negative likelihood, mean over the directions of incidence."""
    urgent, m = torch.tensor(URGENT), len(paths.first) - 1
    said = model.outputs(vector, paths.inputs).gather(1, paths.order[:, None])[:, 0]
    light = points.smith * torch.exp(model.outputs(vector, points.inputs))
    return ((light @ urgent).sum() - (paths.weight * urgent[paths.order] * said).sum()) / m


def fitted(
    model: Correction,
    vector: Tensor,
    paths: Paths,
    points: Points,
    steps: int,
    checkpoint: Path,
    advance: Callable[[int], None],
) -> Tensor:
    """`vector` after `steps` steps, each of the next AT_ONCE directions; gone on from `checkpoint` if there is one."""
    state = AdamState.begun(vector, checkpoint)
    advance(min(state.step, steps))
    m = len(paths.first) - 1
    count = min(AT_ONCE, m)
    while state.step < steps:
        begin = (state.step % (m // count)) * count
        some = paths.part(begin, begin + count), points.part(begin, begin + count)
        state.take(loss(model, state.vector, *some), RATE, LAST_RATE, steps)
        advance(1)
    return state.vector.detach()
