"""The mean of the gradients is the slope of the mean: every material, segment, estimator, parameter and direction.

Every path has a row of its own, with parameters of its own, so that one backward pass gives the gradient of each.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import pytest
import torch
from cases import DISTRIBUTIONS, ELLIPTIC, SCATTERINGS, each
from torch import Tensor

from torchms import RoughConductor, RoughDielectric, RoughDiffuse, Scattering
from torchms.estimators.path_tracer import PathTracer
from torchms.fresnel import Conductor, Dielectric, Schlick
from torchms.testing import estimate, p_value, zscore

MAX_ORDER = 3

ESTIMATORS = [name for name in SCATTERINGS if name != "single"]
"""What is estimated; one bounce is a closed form."""


def estimator_of(name: str, attached: bool | None) -> Scattering:
    """The estimator of this name, with directions that follow in gradients or are held."""
    scattering = SCATTERINGS[name](MAX_ORDER)
    assert isinstance(scattering, PathTracer)
    scattering.attached = attached
    return scattering


MATERIALS = {
    "conductor": (lambda d, s, eta, k: RoughConductor(d, Conductor(eta, k), s), {"eta": 0.4, "k": 3.0}),
    "schlick": (lambda d, s, f0: RoughConductor(d, Schlick(f0), s), {"f0": 0.3}),
    "glass": (lambda d, s, eta: RoughDielectric(d, Dielectric(eta[:, 0]), s), {"eta": 1.5}),
    "diffuse": (lambda d, s, albedo: RoughDiffuse(d, albedo, s), {"albedo": 0.7}),
}
PAIRS = [(m, e) for m, e in itertools.product(MATERIALS, ESTIMATORS) if m != "glass" or not e.endswith("invariance")]
STEPS = {2: 0.02, 4: 0.005}
"""Of every variable, for differences of second and of fourth order; those of a direction turn it about an axis."""


class Problem(NamedTuple):
    """A material in a state: distribution, estimator, and the two directions, which the last four variables turn."""

    material: str
    estimator: str
    distribution: str
    wi: Tensor
    wo: Tensor
    attached: bool | None = None

    @property
    def variables(self) -> dict[str, float]:
        """α_x, α_y, the numbers of the material, and how far wi and wo are turned about y and x [rad]."""
        directions = {"wi about y": 0.0, "wi about x": 0.0, "wo about y": 0.0, "wo about x": 0.0}
        return {"alpha_x": 0.7, "alpha_y": 0.45, **MATERIALS[self.material][1], **directions}

    def orders(self, values: dict[str, Tensor], generator: torch.Generator) -> Tensor:
        """(n, K): each order of each row, every row one path."""
        ax, ay, *numbers, iy, ix, oy, ox = values.values()
        facets = DISTRIBUTIONS[self.distribution](ax, ay)
        numbers = [number[:, None] for number in numbers]
        surface = MATERIALS[self.material][0](facets, estimator_of(self.estimator, self.attached), *numbers)
        u = surface.uniforms((len(ax),), 1, generator=generator)
        return surface.orders(turned(self.wi, iy, ix), turned(self.wo, oy, ox), u)[..., 0]


def turned(w: Tensor, y: Tensor, x: Tensor) -> Tensor:
    """The direction w (3,), turned about the y axis and then about the x axis by an angle a row: (n, 3)."""
    a, b = w[0] * y.cos() + w[2] * y.sin(), w[2] * y.cos() - w[0] * y.sin()
    return torch.stack([a, w[1] * x.cos() - b * x.sin(), w[1] * x.sin() + b * x.cos()], -1)


def gradients(problem: Problem, n: int, generator: torch.Generator) -> Tensor:
    """(n, variables, K): of every order, by every variable, one path each."""
    leaves = {k: torch.full((n,), v, dtype=torch.float64).requires_grad_() for k, v in problem.variables.items()}
    orders = problem.orders(leaves, generator)
    columns = []
    for k in range(MAX_ORDER):
        each_leaf = torch.autograd.grad(orders[:, k].sum(), list(leaves.values()), retain_graph=True, allow_unused=True)
        columns.append(torch.stack([torch.zeros(n) if g is None else g for g in each_leaf], 1))
    return torch.stack(columns, 2)


@torch.no_grad()
def slopes(problem: Problem, n: int, seed: int, common: bool, order: int = 2) -> Tensor:
    """(n, variables, K): differences of every variable, of `order` 2 or 4, with the same random numbers or others."""
    columns = []
    step = STEPS[order]
    stencil = {2: {1: 1 / 2, -1: -1 / 2}, 4: {1: 2 / 3, -1: -2 / 3, 2: -1 / 12, -2: 1 / 12}}[order]
    for i, name in enumerate(problem.variables):
        slope = torch.zeros(n, MAX_ORDER, dtype=torch.float64)
        for j, (steps, share) in enumerate(stencil.items()):
            values = {k: torch.full((n,), v, dtype=torch.float64) for k, v in problem.variables.items()}
            values[name] = values[name] + steps * step
            generator = torch.Generator().manual_seed(seed if common else seed + 17 * (10 * i + j + 1))
            slope += share / step * problem.orders(values, generator)
        columns.append(slope)
    return torch.stack(columns, 1)


def directions(material: str, transmitted: bool) -> tuple[Tensor, Tensor]:
    """Far enough apart for several bounces to matter, off the planes of symmetry."""
    wi = torch.tensor([0.5, 0.3, 0.6], dtype=torch.float64)
    wo = torch.tensor([-0.2, 0.6, -0.5 if transmitted else 0.5], dtype=torch.float64)
    return wi / wi.norm(), wo / wo.norm()


def compared(problem: Problem, n: int, seed: int, common: bool, order: int = 2) -> tuple[Tensor, Callable[[int], str]]:
    """p-values of mean gradient against mean slope, and what the i-th of them is about."""
    mine = gradients(problem, n, torch.Generator().manual_seed(seed))
    theirs = slopes(problem, n, seed, common, order)
    # The rule's own error is step² / 6 or step⁴ / 30 times a higher derivative: each costs a factor of 1 / α² or so.
    scale = mine.abs().mean(0)
    step = STEPS[order]
    error = 2 * step**2 * (scale + scale.max()) if order == 2 else 5e3 * step**4 * scale + 1e-9
    if common:
        z = zscore(estimate(mine - theirs), estimate(torch.zeros_like(mine)), rounding=error)
    else:
        z = zscore(estimate(mine), estimate(theirs), rounding=error)
    names = list(problem.variables)
    return p_value(z), lambda i: f"{names[i // MAX_ORDER]}, order {i % MAX_ORDER + 1}"


CASES = [pytest.param(*pair, "ggx", id="-".join(pair)) for pair in PAIRS]
CASES += [
    pytest.param("conductor", e, "gtr", id=f"{e}-gtr", marks=pytest.mark.slow) for e in ("invariance", "height-walk")
]


@pytest.mark.parametrize("material,estimator,distribution", CASES)
def test_gradients_of_values(material, estimator, distribution, seed, budget):
    """GGX, whose density jumps at the horizon, and, slow, GTR, with finer differences; common random numbers."""
    problem = Problem(material, estimator, distribution, *directions(material, False))
    order = 4 if distribution == "gtr" else 2
    budget(*compared(problem, 3_000 if "bidirectional" in estimator else 6_000, seed, common=True, order=order))


@pytest.mark.slow
@pytest.mark.parametrize("common", [True, False], ids=["common", "independent"])
@pytest.mark.parametrize("material,estimator", PAIRS, ids=["-".join(pair) for pair in PAIRS])
@pytest.mark.parametrize("distribution", ELLIPTIC)
def test_gradients_of_values_precisely(material, estimator, distribution, common, seed, budget):
    """More paths, differences of fourth order; glass from above to below, too."""
    p, labels = [], []
    for transmitted in (False, True) if material == "glass" else (False,):
        problem = Problem(material, estimator, distribution, *directions(material, transmitted))
        some, label = compared(problem, 15_000 if "bidirectional" in estimator else 60_000, seed, common, order=4)
        labels += [f"{'through' if transmitted else 'back'}, {label(i)}" for i in range(some.numel())]
        p.append(some.reshape(-1))
    budget(torch.cat(p), labels.__getitem__)


@each("estimator", ESTIMATORS)
def test_attached_directions_miss_the_jump(estimator, seed):
    """What the default protects from: with GGX mirrors, the mean of attached gradients is another number."""
    problem = Problem("schlick", estimator, "ggx", *directions("schlick", False))
    n = 4_000 if "bidirectional" in estimator else 16_000
    held = estimate(gradients(problem, n, torch.Generator().manual_seed(seed)))
    moved = estimate(gradients(problem._replace(attached=True), n, torch.Generator().manual_seed(seed + 1)))
    assert float(zscore(held, moved)[..., 1].abs().max()) > 6


@each("material", MATERIALS)
def test_held_everywhere_agrees(material, seed, budget):
    """`attached=False`: another estimate of the same gradients, where the default lets directions follow, too."""
    problem = Problem(material, "height-walk", "ggx", *directions(material, False), attached=False)
    budget(*compared(problem, 20_000, seed, common=True))
