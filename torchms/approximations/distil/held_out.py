"""Errors of a distillate where it was not trained: lobes and energies of fixed surfaces and directions of incidence."""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil import energies
from torchms.approximations.distil.rows import KINDS, LEAST_COSINE, Rows
from torchms.approximations.distil.targets import orders
from torchms.approximations.metal_lobes import MetalLobes
from torchms.approximations.metal_sampling import MetalProposal
from torchms.maths.frame import Vec3, join, split
from torchms.sampling.uniforms import draw, generator_for

ALPHAS = ((0.05,), (0.1,), (0.25,), (0.5,), (1.0,), (0.5, 0.15), (1.0, 0.1), (1.0, 0.3))
ANGLES = (0.0, 0.5, 1.0, 1.4)
RANDOM = 200
"""Surfaces and directions anywhere, besides those."""
PHI = 0.4


class Errors(NamedTuple):
    """Of each cell: RMS of the lobe f cos θ_o over the reference's RMS, with the reference's noise taken out; that noise."""

    lobe: Tensor
    noise: Tensor


def cells(alpha: tuple[float, float], seed: int) -> Rows:
    """The fixed surfaces that lie in the range, each at four angles; then the random ones. wo is left at wi."""
    inside = [a for a in ALPHAS if alpha[0] <= min(a) and max(a) <= alpha[1]]
    fixed = [(a[0], a[-1], theta, PHI) for a in inside for theta in ANGLES]
    u = draw((RANDOM,), 1, 4, generator=generator_for(seed))[:, 0]
    low, high = alpha
    ax, ay = low * (high / low) ** u[:, 0], low * (high / low) ** u[:, 1]
    theta = torch.acos((1 - u[:, 2]).clamp_min(0.02))
    columns = torch.tensor(fixed).reshape(-1, 4)
    columns = torch.cat([columns, torch.stack([ax, ay, theta, 2 * math.pi * u[:, 3]], -1)])
    ax, ay, theta, phi = columns.unbind(-1)
    wi = join(Vec3(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()))
    return Rows(ax, ay, wi, wi)


@torch.no_grad()
def lobe_errors(lobes: MetalLobes, kind: str, where: Rows, seed: int, points: int, n_paths: tuple[int, int]) -> Errors:
    """With `points` outgoing directions a cell and two independent references: their product has no noise."""
    count = len(where.ax)
    distribution = KINDS[kind](where.ax[:, None], where.ay[:, None])
    wi = split(where.wi[:, None])
    u = draw((count,), points, 3, generator=generator_for(seed), sequence="sobol").unbind(-1)
    proposal = MetalProposal(distribution)
    wo = proposal.sample(wi, u)
    wo = Vec3(wo.x, wo.y, wo.z.clamp_min(LEAST_COSINE))
    density = proposal.density(wi, wo)
    rows = Rows(
        where.ax[:, None].expand(count, points).reshape(-1),
        where.ay[:, None].expand(count, points).reshape(-1),
        where.wi[:, None].expand(count, points, 3).reshape(-1, 3),
        join(wo).reshape(-1, 3),
    )
    one = KINDS[kind](rows.ax, rows.ay)
    mine = torch.cat([sum_of(lobes, one, some, rows) for some in torch.arange(len(rows.ax)).split(8192)])
    first, second = (orders(kind, rows, 2 * (seed * 4096 + half), n_paths) for half in (0, 1))
    weight = (rows.wo[:, 2] ** 2 / density.reshape(-1)).double()
    a, b = first[:, 1:].sum(-1), second[:, 1:].sum(-1)
    return compared(*(x.double().reshape(count, points) for x in (mine, first[:, 0], a, b, weight)))


def compared(mine: Tensor, first: Tensor, a: Tensor, b: Tensor, weight: Tensor) -> Errors:
    """Of each cell: a model of the rest with two independent estimates of it, beside one bounce; (cells, points), float64.

    weight: the square of what multiplies them, over the density of the points.
    """
    size = (weight * (first + a) * (first + b)).mean(-1)
    error, noise = ((weight * x).mean(-1) / size for x in ((mine - a) * (mine - b), (a - b) ** 2 / 4))
    return Errors(error.clamp_min(0).sqrt(), noise.sqrt())


def sum_of(lobes: MetalLobes, distribution: Any, some: Tensor, rows: Rows) -> Tensor:
    """f [1/sr] of all orders from 2 on, F = 1, at the rows `some`."""
    here = type(distribution)(rows.ax[some], rows.ay[some])
    found = lobes.rest(here, split(rows.wi[some]), split(rows.wo[some])).lobes
    return found[0] + found[1] + found[2]


@torch.no_grad()
def energy_errors(lobes: MetalLobes, kind: str, where: Rows, seed: int) -> Tensor:
    """Energy of the furnace − 1 of each cell, E_1 from the albedo table."""
    rows, weight, lost = energies.pairs(kind, where, seed)
    one = KINDS[kind](rows.ax, rows.ay)
    f = torch.cat([sum_of(lobes, one, some, rows) for some in torch.arange(len(rows.ax)).split(8192)])
    return (f * weight).reshape(len(where.ax), energies.POINTS).sum(-1) - lost


def summary(
    lobes: MetalLobes, kind: str, alpha: tuple[float, float], seed: int, points: int, n_paths: tuple[int, int]
) -> dict[str, Any]:
    """Held-out errors, for the certificate."""
    where = cells(alpha, seed)
    errors = lobe_errors(lobes, kind, where, seed, points, n_paths)
    energy = energy_errors(lobes, kind, where, seed + 1).abs()
    fixed = len(where.ax) - RANDOM
    names = [f"{float(where.ax[k]):g},{float(where.ay[k]):g}" for k in range(0, fixed, len(ANGLES))]
    found: dict[str, Any] = {
        "lobe": {
            name: [round(float(e), 5) for e in errors.lobe[len(ANGLES) * k : len(ANGLES) * (k + 1)]]
            for k, name in enumerate(names)
        },
        "angles": list(ANGLES),
    }
    for name, values in (("random lobe", errors.lobe[fixed:]), ("noise", errors.noise), ("energy", energy)):
        found[name] = {"median": round(float(values.median()), 6), "largest": round(float(values.max()), 6)}
    return found
