"""Light bounced on the facets of an explicit microsurface, counted: the ground truth, without Smith's assumption."""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import groupby
from pathlib import Path

import numpy as np
from torch import Tensor

from torchms.lobes.tally import Tally
from torchms.microsurface.rays.grid_walk import require_numba
from torchms.microsurface.rays.tracer import EmbreeTracer, Tracer
from torchms.microsurface.simulation import distributed
from torchms.microsurface.simulation.checkpoint import Checkpoint
from torchms.microsurface.simulation.materials import FacetMaterial
from torchms.microsurface.simulation.plan import Partial, Plan, Shard, run_surface
from torchms.microsurface.simulation.progress import Progress
from torchms.microsurface.surfaces.heightfield import GaussianSurfaces, Heightfield


def simulate(
    surface: Heightfield | Sequence[Heightfield] | GaussianSurfaces,
    material: FacetMaterial,
    wi: Tensor | np.ndarray | Sequence[float | int],
    *,
    n_rays: int | float,
    max_order: int = 16,
    seed: int = 0,
    tracer: Tracer | None = None,
    interpolate_normals: bool = False,
    lobes: bool = True,
    threads: int | None = None,
    checkpoint: str | Path | None = None,
    progress: bool = False,
    rays_per_shard: int = 65536,
) -> Tally:
    """Share of the incident energy that leaves `surface` up and down after exactly k facet events, k = 1 … `max_order`.

    surface: several surfaces (or a recipe for several) give standard errors from their spread; with a single one
    they come from groups of rays and do not say how far that surface stands for others.
    wi: unit vector away from the surface, above the horizon; rays start above the highest point, everywhere alike.
    n_rays: in all, shared among the surfaces. tracer: `EmbreeTracer()` if None; `GridTracer()` needs no Embree.
    checkpoint: directory of finished shards; a killed run goes on from there, one of another configuration is refused.
    Under an initialised torch.distributed process group the shards are shared out, and every process gets the result.
    It does not depend on `threads`, on the number of processes or on how often it was interrupted, to the last bit.

    `info` of the Tally holds: `lost` (C,), what had not left after `max_order` events plus what leaked by rounding, so
    Σ reflected + Σ transmitted + absorbed + lost = 1; `leak_rate` per segment; `rays_per_second`, `segments_per_second`
    (tracing, scattering and tallying; a segment is one flight from facet to facet) and `seconds`; the measured
    `slopes`; the `configuration`.
    """
    plan = make_plan(
        surface,
        material,
        wi,
        n_rays=n_rays,
        max_order=max_order,
        seed=seed,
        tracer=tracer,
        interpolate_normals=interpolate_normals,
        lobes=lobes,
        rays_per_shard=rays_per_shard,
    )
    store = None if checkpoint is None else Checkpoint.open(Path(checkpoint), plan)
    total = plan.nothing()
    todo = distributed.share_of(take_finished(plan, store, total))
    with Progress(sum(shard.rays for shard in todo), enabled=progress) as bar:
        clock = run_shards(plan, todo, total, threads=threads, store=store, bar=bar)
    distributed.add_up(total)
    clock.join()
    tally = plan.tally(total)
    tally.info.update(clock.report())
    return tally


def take_finished(plan: Plan, store: Checkpoint | None, total: Partial) -> list[Shard]:
    """Add the shards that `store` holds to `total` (each in one process only) and return those to trace."""
    if store is None:
        return list(plan.shards)
    rank, size = distributed.rank_and_size()
    owners = [rank] * len(plan.shards)
    if size > 1:
        # Read twice, so that a file which cannot be read counts as missing everywhere; keep nothing but the sums.
        readable = []
        for shard in plan.shards:
            readable.append(store.load(shard) is not None)
        owners = distributed.owners(readable)
    todo = []
    for shard, owner in zip(plan.shards, owners, strict=True):
        found = store.load(shard) if owner == rank else None
        if found is not None:
            total.add(found, plan.group(shard), shard.surface)
        elif owner < 0 or size == 1:
            todo.append(shard)
        else:
            assert owner != rank, "a shard that could be read a moment ago cannot be read any more"
    return todo


def make_plan(
    surface: Heightfield | Sequence[Heightfield] | GaussianSurfaces,
    material: FacetMaterial,
    wi: Tensor | np.ndarray | Sequence[float | int],
    *,
    n_rays: int | float,
    max_order: int = 16,
    seed: int = 0,
    tracer: Tracer | None = None,
    interpolate_normals: bool = False,
    lobes: bool = True,
    rays_per_shard: int = 65536,
) -> Plan:
    """The plan of `simulate` with these arguments, checked."""
    require_numba()
    direction = wi.detach().cpu().double().numpy() if isinstance(wi, Tensor) else np.asarray(wi, dtype=np.float64)
    return Plan(
        surface=surface,
        material=material,
        wi=np.ascontiguousarray(direction),
        n_rays=int(n_rays),
        max_order=max_order,
        seed=seed,
        tracer=EmbreeTracer() if tracer is None else tracer,
        interpolate_normals=interpolate_normals,
        lobes=lobes,
        rays_per_shard=rays_per_shard,
    )


class Clock:
    """Wall time of the two phases, and the work done in them."""

    def __init__(self) -> None:
        self.surfaces = 0.0
        self.tracing = 0.0
        self.rays = 0
        self.segments = 0

    def join(self) -> None:
        """Make these the numbers of all processes together: the slowest's time, everyone's work."""
        (self.surfaces, self.tracing), (rays, segments) = distributed.slowest_and_sum(
            (self.surfaces, self.tracing), (self.rays, self.segments)
        )
        self.rays, self.segments = int(rays), int(segments)

    def report(self) -> dict[str, float | dict[str, float]]:
        """Speeds of this run alone: shards that were taken from a checkpoint do not count."""
        seconds = max(self.tracing, 1e-9)
        return {
            "rays_per_second": self.rays / seconds,
            "segments_per_second": self.segments / seconds,
            "seconds": {"surfaces": self.surfaces, "tracing": self.tracing},
        }


def run_shards(
    plan: Plan,
    todo: Sequence[Shard],
    total: Partial,
    *,
    threads: int | None = None,
    store: Checkpoint | None = None,
    bar: Progress | None = None,
) -> Clock:
    """Trace the shards of `todo` and add them to `total`; each is stored the moment it is finished."""
    workers = checked_threads(threads)
    distributed.wait_for_all()
    clock = Clock()

    def finish(done: Future, shard: Shard) -> None:
        found = done.result()
        if store is not None:
            store.save(shard, found)
        total.add(found, plan.group(shard), shard.surface)
        clock.rays += int(found.counts[0, 0])
        clock.segments += int(found.counts[0, 1])
        if bar is not None:
            bar.advance(shard.rays)

    with ThreadPoolExecutor(workers) as pool:

        def run(trace: Callable[[Shard], Partial], shards: Sequence[Shard]) -> None:
            clock.surfaces += time.perf_counter() - begin
            start = time.perf_counter()
            waiting: dict[Future, Shard] = {}
            queue = iter(shards)
            try:
                while True:
                    # Few results wait at a time: memory is bounded however many shards there are.
                    while len(waiting) < 2 * workers and (shard := next(queue, None)) is not None:
                        waiting[pool.submit(trace, shard)] = shard
                    if not waiting:
                        break
                    for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                        finish(future, waiting.pop(future))
            except BaseException:
                for future in waiting:
                    future.cancel()
                raise
            clock.tracing += time.perf_counter() - start

        for _, shards in groupby(todo, key=lambda shard: shard.surface):
            begin = time.perf_counter()
            run_surface(plan, list(shards), run)
    return clock


def checked_threads(threads: int | None) -> int:
    """Number of threads to use: if None, all cores that this process may use, shared with its neighbours."""
    if threads is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
        return max(1, cores // distributed.local_size())
    if not 1 <= threads <= 1024:
        raise ValueError(f"simulate(threads=...) must lie in [1, 1024]; got {threads}. None takes every core.")
    return threads
