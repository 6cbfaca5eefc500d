"""A value, a walk and an energy are one model: they agree order by order, and cell by cell."""

import torch
from cases import DISTRIBUTIONS, bsdf, direction, each, models, sides
from torch import Tensor

from torchms import BSDF
from torchms.lobes import measure
from torchms.testing import Estimate, estimate, p_value, zscore
from torchms.testing.chi_square import cell_index

CELLS = (6, 4)
LEAST = 1e-3
"""Energy of an order that is compared however few walks have it."""
RESOLVED = 0.1
"""Relative standard error up to which a cell is compared: rarer events are not normal."""


def integrands(surface: BSDF, wi: Tensor, n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Directions (n, 3) from `sample` and `orders` there over `pdf`, (n, K, C): their mean is the integral over wo."""
    wo, pdf = surface.sample(wi, surface.uniforms((), n, generator=generator))
    return wo, surface.orders(wi, wo, surface.uniforms((n,), 1, generator=generator)) / pdf[:, None, None]


def walked(surface: BSDF, wi: Tensor, n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Directions (n, 3) from `sample_walk` and the weights, each in its order's place, (n, K, C)."""
    wo, weight, order = surface.sample_walk(wi, surface.uniforms((), n, generator=generator))
    place = order[:, None] == torch.arange(1, surface.max_order + 1)
    return wo, place[..., None] * weight[:, None, :]


def by_side(wo: Tensor, energy: Tensor, wi: Tensor) -> Estimate:
    """Mean energies (2, K, C): reflected and transmitted."""
    reflected = ((wo[:, 2] > 0) == (wi[2] > 0))[:, None, None]
    return estimate(torch.stack([energy * reflected, energy * ~reflected], 1))


def by_cell(wo: Tensor, energy: Tensor) -> Estimate:
    """Mean energies (cells, K, C)."""
    cell = torch.nn.functional.one_hot(cell_index(wo, CELLS), CELLS[0] * CELLS[1])
    n = len(wo)
    mean, square = (torch.einsum("nc,nkd->ckd", cell.double(), x) / n for x in (energy, energy**2))
    return Estimate(mean, ((square - mean**2) / n).clamp_min(0).sqrt(), n)


def measured(surface: BSDF, wi: Tensor, n: int, seed: int) -> Estimate:
    """Energies (2, K, C) of the surface's own walk: reflected and transmitted."""
    tally = measure(surface, wi, n_paths=n, seed=seed, progress=False)
    errors = torch.stack([tally.reflected_stderr, tally.transmitted_stderr])
    return Estimate(torch.stack([tally.reflected, tally.transmitted]), errors, tally.n)


def agreement(surface: BSDF, wi: Tensor, n: int, generator: torch.Generator, seed: int) -> Tensor:
    """p-values: ∫ orders = sample_walk = albedo, by order and side; and cell by cell, for the walks."""
    energy = measured(surface, wi, n, seed)
    found, walks = integrands(surface, wi, n, generator), walked(surface, wi, n, generator)
    sides = [by_side(wo, values, wi) for wo, values in (found, walks)]
    # A handful of walks says nothing, not even how little it says.
    p = [p_value(zscore(x, energy))[(x.stderr < RESOLVED * x.mean) | (energy.mean > LEAST)] for x in sides]
    a, b = by_cell(*found), by_cell(*walks)
    resolved = (a.stderr < RESOLVED * a.mean) & (b.stderr < RESOLVED * b.mean)
    assert b.mean[resolved].sum() > 0.9 * b.mean.sum()
    return torch.cat([*(x.reshape(-1) for x in p), p_value(zscore(b, a))[resolved]])


@models()
@each("distribution", DISTRIBUTIONS)
def test_orders_walks_and_energies_agree(material, scattering, distribution, generator, seed, budget):
    """∫ orders dwo = the energy of sample_walk = albedo (by `measure`), each order, each side, lit from each side."""
    surface = bsdf(material, scattering, distribution)
    p = []
    for side in sides(material):
        wi = side * direction(1.0)
        energy = measured(surface, wi, 50_000, seed)
        for wo, values in (
            integrands(surface, wi, 60_000, generator),
            walked(surface, wi, 60_000, generator),
        ):
            p.append(p_value(zscore(by_side(wo, values, wi), energy)))
    shape = p[0].shape
    budget(torch.stack(p), lambda i: [int(x) for x in torch.unravel_index(torch.tensor(i), (len(p), *shape))])


@models()
@each("distribution", DISTRIBUTIONS)
def test_walks_go_where_orders_say(material, scattering, distribution, generator, budget):
    """The histogram of sample_walk over the sphere is that of orders, each order."""
    surface = bsdf(material, scattering, distribution, max_order=3)
    wi = direction(0.6)
    there = by_cell(*integrands(surface, wi, 80_000, generator))
    walks = by_cell(*walked(surface, wi, 80_000, generator))
    resolved = (there.stderr < RESOLVED * there.mean) & (walks.stderr < RESOLVED * walks.mean)
    assert walks.mean[resolved].sum() > 0.9 * walks.mean.sum()
    budget(p_value(zscore(walks, there))[resolved], lambda i: resolved.nonzero()[i].tolist())
