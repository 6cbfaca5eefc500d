"""Objects as the laws see them: float64, one number where a map was; and where numbers are hard."""

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import torch
from torch import Tensor, nn

from torchms.bsdfs.base import BSDF
from torchms.maths.frame import direction
from torchms.parameters.exchange import parameters, weights, with_parameters

M = TypeVar("M", bound=nn.Module)

AZIMUTH = 0.7
"""Of directions where any will do but 0, which hides errors."""
THETAS = (0.0, 1e-4, 0.7, 1.5, math.pi / 2)
STEP = 1e-5
"""Of a central difference, relative to the number that is moved."""


def plain(module: M) -> M:
    """A copy in float64 with the first element of every map of parameters, without graphs, evaluated eagerly."""

    values = {
        name: value.detach().reshape(-1, *value.shape[len(record.batch(value)) :])[0].clone()
        for name, (record, value) in parameters(module).items()
    }
    # A copy cannot be made of what has a graph: the tensors of a scattering lose theirs as well.
    graphs = {name: x.detach() for name, x in weights(module).items() if not x.is_leaf}
    clone = copy.deepcopy(with_parameters(module, values | graphs)).double()
    clone.requires_grad_(False)
    if isinstance(clone, BSDF):
        clone.engine = None
    return clone


def edges() -> tuple[Tensor, Tensor]:
    """Pairs (n, 3) of directions: poles, both sides, the horizon; mirror directions, back along itself, h = 0."""
    some = [side * direction(theta, AZIMUTH) for theta in THETAS for side in (1, -1)]
    some += [torch.tensor(flat, dtype=torch.float64) for flat in ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0])]
    signs = torch.tensor([[1, 1, 1], [-1, -1, -1], [-1, -1, 1], [1, 1, -1]], dtype=torch.float64)
    pairs = [(w, w * sign) for w in some for sign in signs]
    pairs += list(itertools.product(some, some))
    first, second = zip(*pairs, strict=True)
    return torch.stack(first), torch.stack(second)


def unfinished(outputs: dict[str, Tensor], leaves: dict[str, Tensor]) -> tuple[float, str]:
    """How many values and gradients are NaN or infinite, and where the first ones are."""
    bad: list[str] = []
    count = 0
    for name, value in outputs.items():
        wrong = int((~value.isfinite()).sum())
        if wrong:
            count += wrong
            bad.append(f"{name} ({wrong})")
        if not value.requires_grad:
            continue
        found = torch.autograd.grad(value.sum(), list(leaves.values()), retain_graph=True, allow_unused=True)
        for leaf, gradient in zip(leaves, found, strict=True):
            wrong = 0 if gradient is None else int((~gradient.isfinite()).sum())
            if wrong:
                count += wrong
                bad.append(f"d {name} / d {leaf} ({wrong})")
    return float(count), "; ".join(bad[:4])


def slope_error(function: Callable[[Sequence[Tensor]], Tensor], at: Sequence[Tensor]) -> float:
    """Largest difference between gradients of `function` and central differences, relative to its values."""
    leaves = [value.detach().clone().requires_grad_() for value in at]
    worst = 0.0
    jacobian = torch.autograd.functional.jacobian(lambda *values: function(values), tuple(leaves))
    scale = function(leaves).detach()
    for i, leaf in enumerate(leaves):
        columns = jacobian[i].reshape(*scale.shape, -1)
        for j in range(leaf.numel()):
            size = max(abs(float(leaf.detach().reshape(-1)[j])), 1e-3)
            moved = []
            for sign in (1, -1):
                values = [value.detach().clone() for value in leaves]
                values[i].reshape(-1)[j] += sign * STEP * size
                moved.append(function(values).detach())
            slope = (moved[0] - moved[1]) / (2 * STEP)
            exact = columns[..., j] * size
            error = (exact - slope).abs() / (scale.abs() + slope.abs() + 1e-9)
            worst = max(worst, float(error.nan_to_num(math.inf).max()))
    return worst
