"""Light on one explicit surface, from the height map to a file of lobes for `Distilled`."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations.diffuse_surface_lobes import DiffuseSurfaceLobes
from torchms.approximations.distil.blocks import opened
from torchms.approximations.distil.command import commit
from torchms.approximations.distil.processes import processes, threads_of, wait_for_all
from torchms.approximations.distil.rows import Rows
from torchms.approximations.distil.training import inputs_of
from torchms.approximations.free_features import free_features, free_features_of_one
from torchms.approximations.surface_correction import as_beckmann
from torchms.approximations.surface_lobes import SurfaceLobes
from torchms.cli.progress import progress_bar
from torchms.distributions import Tabulated
from torchms.estimators import SingleBounce
from torchms.fresnel import Ideal
from torchms.maths.frame import Vec3, split
from torchms.microsurface.distil import fit, held_out, light
from torchms.microsurface.distil.kinds import KINDS
from torchms.microsurface.distil.smith import smith_orders
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster, GridTracer
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.microsurface.surfaces.synthesis import MAX_SLOPE_CHANGE
from torchms.paths.mirror import Mirror
from torchms.version import __version__

ALPHA = (0.03, 1.0)
"""Range of the roughness of which Smith's lobes are known."""
ANGLES, AZIMUTHS = (0.0, 0.5, 1.0, 1.4), 4


@dataclass(frozen=True)
class Effort:
    """How much light, and how long it is learned from."""

    blocks: int = 64
    steps: int = 2000
    widths: tuple[int, ...] = (32, 24)
    each: tuple[int, ...] = (16,)
    seed: int = 1
    material: str = "conductor"
    eta: float | None = None
    held_out: int = 1 << 17
    threads: int | None = None


def check(surface: Heightfield, coarse: bool) -> None:
    """ValueError for a surface too rough, too smooth or, unless `coarse`, measured too coarsely."""
    change = surface.texel_slope_change
    if change > MAX_SLOPE_CHANGE and not coarse:
        raise ValueError(
            f"distil(surface=...): the slope changes by {change:.2f} (rms) from texel to texel, more than the "
            f"{MAX_SLOPE_CHANGE} that facets resolve, so its bounces would depend on the texels. Measure with a spacing of "
            f"{surface.spacing[0] * MAX_SLOPE_CHANGE / change:.3g}, low-pass the heights, or say --coarse to take the facets "
            "as they are."
        )
    for axis, alpha in zip("xy", surface.alpha, strict=True):
        if not ALPHA[0] <= alpha <= ALPHA[1]:
            raise ValueError(
                f"distil(surface=...): alpha along {axis} is {alpha:.3g}, of which no lobes are known; it must lie in "
                f"[{ALPHA[0]:g}, {ALPHA[1]:g}]. Check --spacing and --height-scale."
            )


def distilled(
    surface: Heightfield, folder: Path, effort: Effort, about: dict[str, Any]
) -> tuple[files.Distillate, list[dict[str, Any]]] | None:
    """Lobes of `surface`, and how far Smith's and they are from light that nothing was learned from; None but in process 0.

    folder: of blocks of light and checkpoints, gone on from. about: what the certificate says of the surface.
    """
    tabulated = surface.distribution()
    ax, ay = (float(alpha) for alpha in tabulated.alphas)
    caster = GridTracer().bind(Grid.of(surface))
    kind = KINDS[effort.material]
    found = traced(folder, effort, about, partial(light.surface_block, caster, kind.facets, (ax, ay), effort.seed))
    if found is None:
        return None
    subject = fit.Subject(
        partial(inputs_of, "Beckmann", functions=(free_features, free_features_of_one)),
        partial(smith_orders, first=tabulated) if effort.material == "conductor" else kind.smith,
        kind,
    )
    sizes = effort.widths, effort.each
    (layers, skip), each = fit.learned(subject, found, sizes, effort.steps, effort.seed, folder)
    certificate = certified(found, about)
    facet, alpha = f"scan{kind.suffix}", reach(tabulated)
    base, slopes = kind.base(), tabulated.mixture
    made = files.Distillate(facet, "Tabulated", alpha, layers, skip, certificate, each, base, slopes)
    rows = report(caster, tabulated, made, effort)
    errors = {name: round(max(row[name]["lobe_error"] for row in rows), 5) for name in MODELS if name in rows[0]}
    return made._replace(certificate=certificate | {"largest lobe error": errors}), rows


def traced(folder: Path, effort: Effort, about: dict[str, Any], block: light.Made) -> light.Light | None:
    """The light of all blocks, by all processes; None but in process 0."""
    rank, world = processes()
    opened(folder, {"version": __version__, "seed": effort.seed, **about})
    numbers = list(range(rank, effort.blocks, world))
    with progress_bar("light", len(numbers)) as advance:
        light.made(folder, numbers, block, threads_of(effort.threads, world), advance)
    wait_for_all(world)
    return light.loaded(folder, effort.blocks, effort.seed) if rank == 0 else None


def certified(found: light.Light, about: dict[str, Any]) -> dict[str, Any]:
    """How a file was made."""
    paths = len(found.where.ax) * light.RAYS
    return {"torchms": __version__, "torch": torch.__version__, "commit": commit(), "paths": paths, **about}


def reach(tabulated: Tabulated) -> tuple[float, float]:
    """Smallest and largest roughness that the lobes of a surface with these slopes are for."""
    low, high = sorted(float(alpha) for alpha in tabulated.alphas)
    return 0.99 * low, 1.01 * high


def cells() -> list[held_out.Cell]:
    """Directions of incidence of a report, on the surface as it is."""
    return [
        held_out.Cell(1.0, 1.0, theta, 2 * math.pi * k / AZIMUTHS)
        for theta in ANGLES
        for k in range(AZIMUTHS if theta > 0 else 1)
    ]


MODELS = ("Smith, Beckmann", "Smith", "distilled")
"""What is compared: Smith's theory with Beckmann of the same variances; of metal also with the surface's own slopes; and
what was learned."""


def gap(row: dict[str, Any], name: str) -> float:
    """Largest gap of the energy of an order."""
    return max(abs(a - b) for a, b in zip(row[name]["energy"], row["energy"], strict=True))


def report(caster: GridCaster, tabulated: Tabulated, made: files.Distillate, effort: Effort) -> list[dict[str, Any]]:
    """Energies and lobes of `MODELS` against light with other random numbers, at four angles and azimuths."""
    ax, ay = (float(alpha) for alpha in tabulated.alphas)
    kind, metal, where = KINDS[effort.material], effort.material == "conductor", cells()
    with progress_bar("held-out light", held_out.HALVES) as advance:
        rays, seed = effort.held_out, effort.seed + 77
        shares = held_out.shares(lambda number: caster, held_out.HALVES, where, rays, seed, advance, kind.facets)
    said = _metal(made, tabulated) if metal else _diffuse(made)

    def rows_of(cell: held_out.Cell, wo: Tensor) -> Rows:
        wi = torch.from_numpy(cell.wi).float().expand_as(wo)
        return Rows(torch.full((len(wo),), ax), torch.full((len(wo),), ay), wi, wo)

    @torch.no_grad()
    def learned(cell: held_out.Cell, wo: Tensor) -> Tensor:
        wi = torch.from_numpy(cell.wi).float().expand_as(wo)
        i, o = (Vec3(*(x[None] for x in split(w))) for w in (wi, wo))
        return torch.stack([x[0] for x in said(i, o)], -1)

    models = {MODELS[0]: held_out.integrated(lambda cell, wo: kind.smith(rows_of(cell, wo)), where)}
    if metal:
        models[MODELS[1]] = held_out.integrated(lambda cell, wo: smith_orders(rows_of(cell, wo), tabulated), where)
    models[MODELS[2]] = held_out.integrated(learned, where)
    return held_out.summary(where, shares, models)


def _metal(made: files.Distillate, tabulated: Tabulated) -> Callable[[Vec3, Vec3], list[Tensor]]:
    """f cos θ_o [1/sr] of each order with F = 1."""
    lobes, vertex, facets = SurfaceLobes(made), Mirror(tabulated, Ideal()), as_beckmann(tabulated)

    def orders(wi: Vec3, wo: Vec3) -> list[Tensor]:
        (first,) = SingleBounce().evaluate(vertex, wi, wo, ())
        return [x[0] for x in lobes.orders(first, facets, vertex.fresnel, wi, wo)]

    return orders


def _diffuse(made: files.Distillate) -> Callable[[Vec3, Vec3], list[Tensor]]:
    """f cos θ_o [1/sr] of each order with the albedo 1."""
    lobes = DiffuseSurfaceLobes(made)
    facets = lobes.facets
    assert facets is not None
    return lambda wi, wo: lobes.white(facets, wi, wo)[0]
