"""What does Smith's theory miss? Energies of ray-traced Gaussian surfaces against it, and the gap taken apart.

    python benchmarks/smith_gap.py [--rays 2e5] [--surfaces 6] [--out FILE] [--force]

Metal with F = 1. For each order: the surface's energy less Smith's, by angle and roughness; by correlation function and by
texels; and of surfaces whose light forgets where it was, which is the experiment that tells two causes apart: after every
bounce the ray goes on in the same direction and at the same height, but above another, random place of the surface. What is
left of the gap then is the correlation of heights along the ray; what has gone is that the facet just left and the next one
belong to the same valley. `docs/what_smith_misses.md` says what was found; `--figures` draws it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from numba import njit

from torchms import Beckmann, Invariance, RoughConductor, Unidirectional
from torchms.fresnel import Ideal
from torchms.lobes.measure import measure
from torchms.microsurface import GridTracer, Heightfield
from torchms.microsurface.rays.embree_kernels import surface_height
from torchms.microsurface.rays.grid import ESCAPED, Grid, Paths
from torchms.microsurface.rays.grid_walk import GridCaster
from torchms.microsurface.simulation.exits import stretched
from torchms.microsurface.simulation.facets import scatter_mirror
from torchms.microsurface.simulation.launch import launch
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

ALPHAS = (0.25, 0.5, 1.0)
THETAS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.2, 1.4, 1.5)
FEW = (0.0, 0.5, 1.0, 1.4)
ORDERS = 4
LONGEST = 40
DISTANCES = np.linspace(0, 4, 33)
"""Edges of the distances between the first and the second facet, in correlation lengths."""


@dataclass
class Options:
    """Measure what Smith's theory misses."""

    rays: float = 2e5
    """Light paths of each surface, roughness and angle."""
    surfaces: int = 6
    """Independent surfaces; standard errors come from their spread."""
    walks: float = 2e5
    """Paths of Smith's model."""
    seed: int = 1
    """Seed of everything."""
    out: Path = Path(__file__).parent / "results" / "smith_gap.json"
    """Where the numbers go."""
    figures: Path | None = None
    """Folder for the figures, drawn from the numbers in `out`; nothing is simulated then."""
    force: bool = False
    """Overwrite the numbers."""


def heights(kind: str, size: int, texels: float, seed: int) -> np.ndarray:
    """Periodic Gaussian heights with the autocorrelation exp(−r²/l²), or exp(−r/l) smoothed over l/8, l of `texels`."""
    noise = np.fft.rfft2(np.random.Generator(np.random.Philox(seed)).standard_normal((size, size)))
    kx, ky = 2 * math.pi * np.fft.fftfreq(size), 2 * math.pi * np.fft.rfftfreq(size)
    k2 = (kx[:, None] ** 2 + ky[None, :] ** 2) * texels**2
    power = np.exp(-k2 / 4) if kind == "gaussian" else (1 + k2) ** -1.5 * np.exp(-k2 / 256)
    noise *= np.sqrt(power)
    noise[0, 0] = 0
    return np.fft.irfft2(noise, s=(size, size))


def tile(kind: str, size: int, texels: float, seed: int) -> GridCaster:
    """A surface with α = 1 on both axes, whose unit of length is l."""
    h = heights(kind, size, texels, seed)
    slope = [float(np.sqrt(np.mean((np.roll(h, -1, axis) - h) ** 2))) for axis in (0, 1)]
    dx = 1 / texels
    h *= math.sqrt(0.5) * dx / slope[0]
    dy = slope[1] / slope[0] * dx
    return GridTracer().bind(Grid.of(Heightfield(h, (dx, dy))))


def traced(
    caster: GridCaster, theta: float, rays: int, key: int, forgets: bool, seen: np.ndarray | None = None
) -> np.ndarray:
    """Energies of the orders 1, 2, 3 and ≥ 4 of one surface; `seen` (2, bins) counts distances and sums slopes, if given."""
    grid, rng = caster.grid, np.random.default_rng(key)
    p = Paths.empty(rays, 1, False)
    p.n = rays
    wi = np.array([math.sin(theta), 0.0, math.cos(theta)])
    place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
    n_x, n_y = grid.heights.shape
    launch(0, rays, np.array([key, 1], np.uint32), wi, n_x, n_y, grid.launch_height, *place, rays)
    counts, cosine, start = np.zeros(ORDERS), np.empty(rays), np.empty((4, rays))
    for events in range(LONGEST):
        caster.cast(p)
        left = p.tri[: p.n] == ESCAPED
        counts[min(max(events, 1), ORDERS) - 1] += left.sum()
        stays = p.tri[: p.n] >= 0
        p.n = int(stays.sum())
        for x in place:
            x[: p.n] = x[: len(stays)][stays]
        if events == 1 and seen is not None:
            look(grid, p, start[:, stays], seen)
        if not p.n:
            break
        scatter_mirror(grid.heights, grid.kx, grid.ky, False, p.x, p.y, p.d, p.tri, p.side, cosine, p.n)
        if events == 0 and seen is not None:
            start = np.stack([p.x[: p.n], p.y[: p.n], *slopes(grid, p)])
        if forgets:
            forget(grid, p, rng)
    return counts / rays


def slopes(grid: Grid, p: Paths) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the facets that the paths are on, along x and y."""
    h = grid.heights.astype(np.float64)
    nx, ny = h.shape
    cell, upper = p.tri[: p.n] >> 1, p.tri[: p.n] & 1
    i, j = cell // ny, cell % ny
    k, m = (i + 1) % nx, (j + 1) % ny
    sx = np.where(upper, h[k, m] - h[i, m], h[k, j] - h[i, j])
    sy = np.where(upper, h[k, m] - h[k, j], h[i, m] - h[i, j])
    return grid.kx * sx, grid.ky * sy


def look(grid: Grid, p: Paths, start: np.ndarray, seen: np.ndarray) -> None:
    """Count paths by the distance from their first to their second facet, and sum what slope both have along the ray."""
    nx, ny = grid.heights.shape
    u, v = p.d[: p.n, 0], p.d[: p.n, 1]
    flat = np.maximum(np.hypot(u, v), 1e-12)
    sx, sy = slopes(grid, p)
    first, second = (start[2] * u + start[3] * v) / flat, (sx * u + sy * v) / flat
    # A path is far shorter than the tile.
    dx, dy = ((b - a + n / 2) % n - n / 2 for a, b, n in ((start[0], p.x[: p.n], nx), (start[1], p.y[: p.n], ny)))
    place = np.digitize(np.hypot(dx / grid.scale[0], dy / grid.scale[1]), DISTANCES) - 1
    for row, value in enumerate((np.ones_like(first), first, second, first * second)):
        seen[row] += np.bincount(place, value, minlength=len(DISTANCES))[: len(DISTANCES)]


@njit
def heights_at(h, x, y):
    """Heights of the mesh at many places."""
    found = np.empty(len(x))
    for r in range(len(x)):
        found[r] = surface_height(h, x[r], y[r])
    return found


def forget(grid: Grid, p: Paths, rng: np.random.Generator) -> None:
    """Put every path above another place of the surface that is lower than it is."""
    nx, ny = grid.heights.shape
    todo = np.arange(p.n)
    while len(todo):
        x, y = rng.random(len(todo)) * nx, rng.random(len(todo)) * ny
        good = heights_at(grid.heights, x, y) < p.z[todo] - 1e-6
        p.x[todo[good]], p.y[todo[good]] = x[good], y[good]
        todo = todo[~good]
    p.tri[: p.n] = -1


def smith(alpha: float, theta: float, walks: int) -> np.ndarray:
    """Energies of Smith's model."""
    surface = RoughConductor(Beckmann(alpha), Ideal(), Unidirectional(Invariance(), 8))
    wi = torch.tensor([math.sin(theta), 0.0, math.cos(theta)])
    found = measure(surface, wi, n_paths=walks, progress=False).reflected[:, 0].numpy()
    return np.array([*found[:3], found[3:].sum()])


def case(
    make: Callable[[int], GridCaster], alpha: float, theta: float, options: Options, forgets: bool = False
) -> dict:
    """One angle of one kind of surface."""
    energies, seen = [], np.zeros((4, len(DISTANCES)))
    for number in range(options.surfaces):
        caster = stretched(make(number), alpha, alpha)
        key = options.seed * 100_000 + number
        energies.append(traced(caster, theta, int(options.rays), key, forgets, None if forgets else seen))
    every = np.array(energies)
    error = every.std(0, ddof=1) / math.sqrt(len(every)) if len(every) > 1 else np.zeros(ORDERS)
    return {
        "alpha": alpha,
        "theta": theta,
        "energy": every.mean(0).tolist(),
        "stderr": error.tolist(),
        "smith": smith(alpha, theta, int(options.walks)).tolist(),
        "seen": seen.tolist(),
    }


def main(options: Options) -> None:
    if options.figures is not None:
        from smith_gap_figures import draw

        return draw(options.out, options.figures)
    check_writable(options.out, options.force)
    seeds = np.random.SeedSequence(options.seed).generate_state(64).tolist()

    def tiles(kind: str = "gaussian", size: int = 1024, texels: float = 16.0) -> Callable[[int], GridCaster]:
        made = [tile(kind, size, texels, seeds[k]) for k in range(options.surfaces)]
        return made.__getitem__

    content: dict = {
        "command": f"python benchmarks/smith_gap.py --rays {options.rays:g} --surfaces {options.surfaces} "
        f"--walks {options.walks:g} --seed {options.seed}",
        "version": __version__,
        "distances": DISTANCES.tolist(),
    }

    def put(name: str, rows: list[dict]) -> None:
        content[name] = rows
        write_json(options.out, content, force=True)
        print(name, flush=True)

    usual = tiles()
    put("angles", [case(usual, a, t, options) for a in ALPHAS for t in THETAS])
    put("forgetful", [case(usual, a, t, options, True) for a in ALPHAS for t in FEW])
    rough = tiles("exponential", 2048, 64.0)
    put("exponential", [case(rough, a, t, options) for a in (0.5, 1.0) for t in FEW])
    rows = []
    for texels in (8, 16, 32):
        made = tiles("gaussian", 32 * texels, texels)
        rows += [case(made, 1.0, t, options) | {"texels": texels} for t in FEW]
    put("texels", rows)


if __name__ == "__main__":
    main(tyro.cli(Options))
