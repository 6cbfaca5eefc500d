"""Light on one explicit surface of glass, from the height map to a file of lobes for `Distilled`: see `scan`."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.free_glass_features import FREE
from torchms.approximations.glass_surface_lobes import GlassSurfaceLobes
from torchms.cli.progress import progress_bar
from torchms.distributions import Tabulated
from torchms.fresnel import Dielectric
from torchms.maths.frame import Vec3, split
from torchms.microsurface.distil import glass, glass_report, held_out, light
from torchms.microsurface.distil.glass_report import FROM, Orders, incident
from torchms.microsurface.distil.scan import MODELS, Effort, cells, certified, reach, traced
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster, GridTracer
from torchms.microsurface.simulation.materials import DielectricFacets
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.paths.refractive import Refractive


def distilled(
    surface: Heightfield, folder: Path, effort: Effort, about: dict[str, Any]
) -> tuple[files.Distillate, list[dict[str, Any]]] | None:
    """Lobes of `surface`, and how far Smith's and they are from light that nothing was learned from; None but in process 0.

    See `scan.distilled`; light comes from outside and from inside.
    """
    assert effort.eta is not None
    tabulated = surface.distribution()
    ax, ay = (float(alpha) for alpha in tabulated.alphas)
    casters = [GridTracer().bind(Grid.of(seen)) for seen in (surface, light.turned_over(surface))]
    facets = [DielectricFacets(effort.eta), DielectricFacets(1 / effort.eta)]
    found = traced(folder, effort, about, partial(light.glass_block, casters, facets, (ax, ay), effort.seed))
    if found is None:
        return None
    sizes = effort.widths, effort.each
    reflected, transmitted = glass.learned(found, FREE, tabulated, sizes, effort.steps, effort.seed, folder)
    (layers, skip), each = reflected
    certificate, eta = certified(found, about), (effort.eta, effort.eta)
    made = files.Distillate(
        *("scan_glass", "Tabulated", reach(tabulated), layers, skip, certificate, each),
        smith=glass.base(),
        slopes=tabulated.mixture,
        through=transmitted,
        eta=eta,
    )
    rows = report(casters, facets, tabulated, made, effort)
    gaps = {name: round(math.sqrt(sum(gap(row, name) ** 2 for row in rows) / len(rows)), 5) for name in MODELS}
    return made._replace(certificate=certificate | {"rms of the largest energy gaps": gaps}), rows


def gap(row: dict[str, Any], name: str) -> float:
    """Largest gap of the energies of one bounce and of all others; Smith's further ones are known together only."""
    off = [a - b for a, b in zip(row[name]["energy"], row["energy"], strict=True)]
    return max(abs(off[0]), abs(sum(off[1:])))


def report(
    casters: list[GridCaster],
    facets: list[DielectricFacets],
    tabulated: Tabulated,
    made: files.Distillate,
    effort: Effort,
) -> list[dict[str, Any]]:
    """Energies and lobes of `MODELS`, reflected and transmitted, against light with other random numbers, from both sides."""
    rows, where, lobes = [], cells(), GlassSurfaceLobes(made)
    ax, ay = (float(alpha) for alpha in tabulated.alphas)
    with progress_bar("held-out light", 2 * held_out.HALVES) as advance:
        for k, (caster, material) in enumerate(zip(casters, facets, strict=True)):
            rays, seed = effort.held_out, effort.seed + 77 + k
            found = held_out.shares([caster] * 2, held_out.HALVES, where, rays, seed, advance, material, sides=2)
            said = models(lobes, tabulated, material.eta)
            rows += glass_report.rows(where, [(ax, ay)] * len(where), found, said, material.eta, FROM[k])
    return rows


def models(lobes: GlassSurfaceLobes, tabulated: Tabulated, eta: float) -> dict[str, Orders]:
    """What each of `MODELS` says; η of the other side."""
    vertex = Refractive(tabulated, Dielectric(eta))
    ax, ay = (float(alpha) for alpha in tabulated.alphas)

    def smith(first: Tabulated | None, cell: held_out.Cell, wo: Tensor) -> Tensor:
        one = torch.ones(len(wo))
        return glass.smith_glass(Surfaces(ax * one, ay * one, eta * one, incident(cell, wo)), wo, first)

    @torch.no_grad()
    def learned(cell: held_out.Cell, wo: Tensor) -> Tensor:
        wi, out = (Vec3(*(x[None] for x in split(w))) for w in (incident(cell, wo), wo))
        return torch.stack([order[0, 0] for order in lobes.evaluate(vertex, wi, out)], -1)

    return dict(zip(MODELS, (partial(smith, None), partial(smith, tabulated), learned), strict=True))
