"""Errors of distilled glass where it was not trained: lobes on either side, and energies, of fixed surfaces and angles."""

from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil import glass_rows, glass_targets
from torchms.approximations.distil.glass_fit import inputs_of
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.distil.held_out import ALPHAS, ANGLES, PHI, Errors, compared
from torchms.approximations.glass_lobes import EXPONENT, GlassLobes
from torchms.maths.frame import direction
from torchms.sampling.uniforms import generator_for

ETAS = (1.1, 1.5, 2.0, 1 / 1.1, 1 / 1.5, 1 / 2.0)
"""Of the side that light does not come from, relative to the side that it comes from."""
POINTS, PATHS = 64, (32, 64)
"""Outgoing directions of a lobe, and paths of either reference there."""
QUADRATURE = 8192
"""Outgoing directions of an energy."""
LEAST = 1e-3
"""Share of the light below which a lobe has no error of its own: beyond total reflection it may be nothing at all."""


class Table(NamedTuple):
    """Errors of each cell: of the lobe above and of that below, nan for one that carries nothing; and R + T − 1."""

    where: Surfaces
    up: Errors
    down: Errors
    energy: Tensor


def cells(alpha: tuple[float, float]) -> Surfaces:
    """The fixed surfaces that lie in the range, with every index and angle."""
    inside = [a for a in ALPHAS if alpha[0] <= min(a) and max(a) <= alpha[1]]
    rows = [(a[0], a[-1], eta, *direction(theta, PHI).tolist()) for a in inside for eta in ETAS for theta in ANGLES]
    found = torch.tensor(rows).reshape(-1, 6)
    return Surfaces(found[:, 0], found[:, 1], found[:, 2], found[:, 3:])


@torch.no_grad()
def rest(lobes: GlassLobes, kind: str, where: Surfaces, wo: Tensor, up: bool) -> Tensor:
    """f |cos θ_o| [1/sr] of all bounces but the first (n)."""
    side = lobes.reflected if up else lobes.transmitted
    parts = []
    for some in torch.arange(len(wo)).split(16384):
        inputs, scale = inputs_of(kind, where.part(some), wo[some], up)
        both = torch.stack([inputs.one, inputs.other]).unbind(-1)
        parts.append(torch.exp(side(inputs.pair.unbind(-1), both).clamp(*EXPONENT)) * scale)
    return torch.cat(parts)


@torch.no_grad()
def table(lobes: GlassLobes, kind: str, where: Surfaces, seed: int) -> Table:
    """Errors with two independent references, whose product has no noise; energies by quadrature over either side."""
    energy = glass_targets.first_energy(kind, where, seed, 1 << 15) - 1
    found = []
    for up in (True, False):
        points = glass_rows.lobes(kind, where, up, POINTS, generator_for(seed + 1 + up))
        many, wo = where.repeated(POINTS), points.wo.reshape(-1, 3).contiguous()
        mine = rest(lobes, kind, many, wo, up)
        (first, a), (_, b) = (
            glass_targets.estimated(kind, many, wo, 4 * seed + 2 * up + half, PATHS) for half in (0, 1)
        )
        mine, first, a, b = (x.double().view(-1, POINTS) for x in (mine, first, a, b))
        errors, weights = compared(mine, first, a, b, points.weights.double()), points.weights.double()
        dark = ((first + (a + b) / 2) * weights).sum(1) < LEAST
        found.append(Errors(*(x.masked_fill(dark, torch.nan) for x in errors)))
        for some in torch.arange(len(energy)).split(64):
            points = glass_rows.lobes(kind, where.part(some), up, QUADRATURE, generator_for(seed + 3 + up))
            value = rest(lobes, kind, where.part(some).repeated(QUADRATURE), points.wo.reshape(-1, 3), up)
            energy[some] += (value.view(-1, QUADRATURE) * points.weights).sum(1)
    up_there, down_there = found
    return Table(where, up_there, down_there, energy)


def summary(lobes: GlassLobes, kind: str, alpha: tuple[float, float], seed: int) -> dict[str, Any]:
    """Held-out errors, for the certificate."""
    found = table(lobes, kind, cells(alpha), seed)
    columns = {
        "reflected lobe": found.up.lobe,
        "transmitted lobe": found.down.lobe,
        "noise": torch.cat([found.up.noise, found.down.noise]),
        "energy": found.energy.abs(),
    }
    columns = {name: x[~x.isnan()] for name, x in columns.items()}
    return {
        name: {"median": round(float(x.median()), 6), "90 %": round(float(x.quantile(0.9)), 6)}
        | {"largest": round(float(x.max()), 6)}
        for name, x in columns.items()
    }
