"""One shard on one surface: launched, traced, scattered and tallied; depends on the plan and the shard's number only."""

from collections.abc import Callable, Sequence

import numpy as np

from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.rays.tracer import Caster, TraceCount
from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Plan, Shard
from torchms.microsurface.simulation.seeds import shard_key
from torchms.microsurface.surfaces.heightfield import Heightfield


def run_shard(plan: Plan, shard: Shard, grid: Grid, caster: Caster, measured: np.ndarray) -> Partial:
    """Trace one shard; depends on nothing but the plan and the shard's number."""
    from torchms.microsurface.simulation.launch import launch
    from torchms.microsurface.simulation.settle import remaining, settle

    material, channels = plan.material, plan.material.channels
    found = Partial.zeros(1, 1, plan.max_order, channels, plan.lobes)
    found.measured[0] = measured
    paths = Paths.empty(min(plan.rays_per_batch, shard.rays), channels, material.weighted)
    p, trace, segments = paths, TraceCount(), 0
    key = shard_key(plan.seed, shard.surface, shard.part)
    place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
    nx, ny = grid.heights.shape
    for first in range(0, shard.rays, plan.rays_per_batch):
        p.n = min(plan.rays_per_batch, shard.rays - first)
        p.weight[: p.n] = 1
        launch(first, shard.rays, key, plan.wi, nx, ny, grid.launch_height, *place, p.n)
        for events in range(plan.max_order + 1):
            if events:
                material.scatter(p, grid, events, key, plan.interpolate_normals)
            segments += p.n
            trace.add(caster.cast(p))
            energies = (found.reflected[0], found.transmitted[0], found.leaked[0], found.lobes[0])
            p.n = settle(events, material.factor(events), material.weighted, p.weight, *energies, *place, p.n)
            if not p.n:
                break
        remaining(material.factor(plan.max_order), material.weighted, p.weight, found.remaining[0], p.n)
    found.counts[0] = (shard.rays, segments, trace.casts, trace.repeats, trace.leaked)
    return found


def measure(surface: Heightfield) -> np.ndarray:
    """The numbers of `MEASURED` for one surface."""
    report = surface.report()
    return np.array([*report["slope_variance"], *report["slope_distance"]])


def run_surface(
    plan: Plan,
    shards: Sequence[Shard],
    run: Callable[[Callable[[Shard], Partial], Sequence[Shard]], None],
) -> None:
    """Build the surface of `shards` (all of the same one) and hand `run` the function that traces one of them."""
    surface = plan.make_surface(shards[0].surface)
    measured = measure(surface)
    grid = Grid.of(surface)
    caster = plan.tracer.bind(grid)
    # A few rays first: Numba compiles or loads its kernels here, and no speed is measured on that.
    run_shard(plan, Shard(-1, shards[0].surface, 0, 8), grid, caster.fork(), measured)
    run(lambda shard: run_shard(plan, shard, grid, caster.fork(), measured), shards)
