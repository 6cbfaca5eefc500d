"""Simulated light paths as rows: where each came from and where it left, after how many bounces; no bins."""

import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations.coordinates import ETA
from torchms.approximations.distil import glass_rows, scenes
from torchms.approximations.distil.rows import LEAST_COSINE, Rows
from torchms.evaluation.workers import Workers
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster, GridTracer
from torchms.microsurface.simulation.exits import exits, stretched
from torchms.microsurface.simulation.materials import DielectricFacets, FacetMaterial
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.sampling.uniforms import draw, generator_for, permutation
from torchms.storage.archives import read_arrays
from torchms.storage.write import write_whole

SIZE = 1024
"""Texels along each edge of a Gaussian tile, 16 a correlation length."""
BATCHES, DIRECTIONS, RAYS = 16, 32, 256
"""Roughnesses of one block, directions of incidence of each, and paths of each of those."""
GLASS_BATCHES = 64
"""The same of glass: each has an index of its own, too."""
PATHS = BATCHES * DIRECTIONS * RAYS
"""Paths of a block."""
LONGEST = 30
"""Most bounces that are followed."""
KEPT = 0.25
"""Share of the paths of one bounce that are kept; they stand for all of that direction."""
MARGIN = 1.06
"""Factor by which roughnesses reach beyond the range at either end, so that its ends are no ends of the training."""
ANY = (0.1, 1.0)
RATIOS = (1.3, ETA)
"""Smallest and largest ratio of the indices that lobes of glass serve, the larger over the smaller.

Nearer to 1, grazing light crosses several facets and hardly turns: lobes of three bounces and more become needles.
"""
LEAST_RATIO = 1.1 / glass_rows.MARGIN
"""Smallest one that is learned from."""
INDICES = 1 << 40
"""What is added to the seed of the roughnesses for that of the indices."""
MOST_BYTES = 1 << 28
COLUMNS = ("ax", "ay", "wi", "wo", "order", "steep")

Made = Callable[[int], dict[str, np.ndarray]]
"""The rows of a block, by its number."""


class Light(NamedTuple):
    """Paths that left, direction by direction.

    where: the directions (m), wo is left at wi. first: (m + 1) where the paths of each begin. rows: the paths (n).
    order: (n) int64. steep: Σ (1 − c)⁵ (n). weight: paths (n) that each stands for, of RAYS a direction. eta: relative index
    of the other side (m), where facets are of glass.
    """

    where: Rows
    first: Tensor
    rows: Rows
    order: Tensor
    steep: Tensor
    weight: Tensor
    eta: Tensor | None = None

    def part(self, chosen: Tensor) -> "Light":
        """Those of the paths that `chosen` (n) says, of all directions."""
        before = torch.cat([torch.zeros(1, dtype=torch.int64), chosen.cumsum(0)])
        rows = Rows(*(x[chosen] for x in self.rows))
        order, steep, weight = (x[chosen] for x in (self.order, self.steep, self.weight))
        return Light(self.where, before[self.first], rows, order, steep, weight, self.eta)


def gaussian_block(facets: FacetMaterial, alpha: tuple[float, float], seed: int, number: int) -> dict[str, np.ndarray]:
    """Light on one Gaussian tile that is stretched to BATCHES roughnesses."""
    return _stretched_tile([facets] * BATCHES, alpha, seed, number)


def gaussian_glass_block(alpha: tuple[float, float], seed: int, number: int) -> dict[str, np.ndarray]:
    """Light on one Gaussian tile of glass that is stretched to GLASS_BATCHES roughnesses, each with an index of its own.

    Turned over, a Gaussian surface is one of the same kind: light from inside comes from above, to a relative index below 1.
    """
    generator = generator_for(seed * 1_000_003 + number + INDICES)
    etas = scenes.indices(GLASS_BATCHES, math.log(LEAST_RATIO), RATIOS[1] * glass_rows.MARGIN, generator)
    found = _stretched_tile([DielectricFacets(float(eta)) for eta in etas], alpha, seed, number)
    return found | {"eta": np.repeat(etas.numpy().astype(np.float32), PATHS // GLASS_BATCHES)}


def _stretched_tile(
    facets: Sequence[FacetMaterial], alpha: tuple[float, float], seed: int, number: int
) -> dict[str, np.ndarray]:
    """Light on one Gaussian tile, stretched to a roughness for each of these facets."""
    caster = GridTracer().bind(Grid.of(Heightfield.gaussian(1.0, size=SIZE, seed=seed * 1000 + number)))
    where = incidence(alpha, BATCHES * DIRECTIONS, generator_for(seed * 1_000_003 + number))
    each, parts = BATCHES * DIRECTIONS // len(facets), []
    for k, material in enumerate(facets):
        some = slice(k * each, (k + 1) * each)
        ax, ay = float(where.ax[some][0]), float(where.ay[some][0])
        parts.append(_traced(stretched(caster, ax, ay), material, (ax, ay), where.wi[some], (number, k)))
    return {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}


def surface_block(
    caster: GridCaster, facets: FacetMaterial, alpha: tuple[float, float], seed: int, number: int
) -> dict[str, np.ndarray]:
    """Light on one explicit surface."""
    wi = incidence(ANY, BATCHES * DIRECTIONS, generator_for(seed * 1_000_003 + number)).wi
    return _traced(caster, facets, alpha, wi, (seed, number))


def glass_block(
    casters: Sequence[GridCaster], facets: Sequence[FacetMaterial], alpha: tuple[float, float], seed: int, number: int
) -> dict[str, np.ndarray]:
    """Light on one explicit surface of glass: from above on even blocks, from below, seen from there, on odd ones."""
    side = number % 2
    found = surface_block(casters[side], facets[side], alpha, seed, number)
    return found | {"eta": np.full(len(found["ax"]), facets[side].describe()["eta"], dtype=np.float32)}


def turned_over(surface: Heightfield) -> Heightfield:
    """The surface as light from below sees it: all points mirrored in the origin."""
    return Heightfield(-surface.heights[::-1, ::-1], surface.spacing)


def incidence(alpha: tuple[float, float], count: int, generator: torch.Generator) -> Rows:
    """Roughnesses and directions of incidence; wo is left at wi. Three of ten isotropic; all angles alike.

    More roughnesses at either end of the range than between, as nodes of interpolation are.
    """
    u = draw((count,), 1, 5, generator=generator)[:, 0].unbind(-1)
    low, high = alpha[0] / MARGIN, alpha[1] * MARGIN
    ax, ay = (low + (high - low) * (0.5 - 0.5 * torch.cos(math.pi * x)) for x in u[:2])
    theta, phi = 0.5 * math.pi * u[3], 2 * math.pi * u[4]
    z = theta.cos().clamp_min(LEAST_COSINE)
    r = (1 - z * z).sqrt()
    wi = torch.stack([r * phi.cos(), r * phi.sin(), z], -1)
    return Rows(ax, torch.where(u[2] < 0.3, ax, ay), wi, wi)


def _traced(
    caster: GridCaster, facets: FacetMaterial, alpha: tuple[float, float], wi: Tensor, key: tuple[int, int]
) -> dict[str, np.ndarray]:
    """RAYS paths from each direction, one after the other; in turns, so that each is all over the tile."""
    unit = wi.double().numpy()
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    found = exits(caster, facets, np.tile(unit, (RAYS, 1)), np.array(key, dtype=np.uint32), LONGEST)
    n = len(unit)
    sorted_by = np.arange(n * RAYS).reshape(RAYS, n).T.ravel()
    ax, ay = (np.full(n * RAYS, a, dtype=np.float32) for a in alpha)
    columns = (
        ax,
        ay,
        np.repeat(unit.astype(np.float32), RAYS, 0),
        *(x[sorted_by] for x in (found.wo, found.order, found.steep)),
    )
    return dict(zip(COLUMNS, columns, strict=True))


def made(folder: Path, numbers: Sequence[int], block: Made, threads: int, advance: Callable[[int], None]) -> None:
    """Write those of the blocks `numbers` that are not in `folder`, whole or not at all."""

    def one(number: int) -> None:
        path = folder / f"light-{number:05d}.npz"
        if not path.exists():
            file = io.BytesIO()
            content: dict[str, Any] = block(number)
            np.savez(file, **content)
            write_whole(path, file.getvalue(), force=True)

    with Workers(threads) as workers:
        for _ in workers.map(one, numbers):
            advance(1)


def loaded(folder: Path, count: int, seed: int) -> Light:
    """The paths of the first `count` blocks; of one bounce only KEPT of them, which weigh as much as all."""
    parts: list[dict[str, np.ndarray]] = []
    for number in range(count):
        block = read_arrays(folder / f"light-{number:05d}.npz", MOST_BYTES)
        order = block["order"].reshape(-1, RAYS)
        u = draw(order.shape[:1], RAYS, 1, generator=generator_for(seed + number))[..., 0].numpy()
        once = order == 1
        kept = (order > 1) | (once & (u < KEPT))
        weight = once.sum(1, keepdims=True) / np.maximum((once & kept).sum(1, keepdims=True), 1)
        block["weight"] = np.where(once, weight, 1.0).astype(np.float32).ravel()
        chosen = kept.ravel()
        part = {name: block[name][chosen] for name in (*COLUMNS, "weight")}
        part |= {f"{name} there": block[name][::RAYS] for name in ("ax", "ay", "wi", "eta") if name in block}
        parts.append({"kept": kept.sum(1)} | part)
    kept, ax, ay, wi, wo, order, steep, weight, ax0, ay0, wi0, *etas = (
        torch.from_numpy(np.concatenate([part[name] for part in parts])) for name in parts[0]
    )
    # In an order of their own, so that any of them one after the other speak for all.
    chosen = permutation(len(kept), generator_for(seed))
    place = torch.empty_like(chosen)
    place[chosen] = torch.arange(len(chosen))
    by = torch.argsort(place.repeat_interleave(kept), stable=True)
    first = torch.cat([torch.zeros(1, dtype=torch.int64), kept[chosen].cumsum(0)])
    where = Rows(*(x[chosen] for x in (ax0, ay0, wi0, wi0)))
    rows, eta = Rows(*(x[by] for x in (ax, ay, wi, wo))), etas[0][chosen] if etas else None
    return Light(where, first, rows, order[by].long(), steep[by], weight[by], eta)
