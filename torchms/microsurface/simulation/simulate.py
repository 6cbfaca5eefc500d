"""Light bounced on the facets of an explicit microsurface, counted: the ground truth, without Smith's assumption."""

from pathlib import Path
from typing import Any

from torchms.cli.progress import progress_bar
from torchms.lobes.tally import Tally
from torchms.microsurface.rays.grid_walk import require_numba
from torchms.microsurface.simulation import distributed
from torchms.microsurface.simulation.checkpoint import Checkpoint
from torchms.microsurface.simulation.materials import FacetMaterial
from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Incidence, Plan, Shard, Surfaces
from torchms.microsurface.simulation.result import tally
from torchms.microsurface.simulation.schedule import run_shards


def simulate(
    surface: Surfaces,
    material: FacetMaterial,
    wi: Incidence,
    *,
    threads: int | None = None,
    checkpoint: str | Path | None = None,
    progress: bool = False,
    **settings: Any,
) -> Tally:
    """Share of the incident energy that leaves `surface` up and down after exactly k facet events, k = 1 … `max_order`.

    surface, material, wi and the `settings` (n_rays, max_order, seed, tracer, interpolate_normals, lobes, rays_per_shard) are
    those of `Plan`.
    checkpoint: directory of finished shards; a killed run goes on from there, one of another configuration is refused.
    Under an initialised torch.distributed process group the shards are shared out, and every process gets the result.
    It does not depend on `threads`, on the number of processes or on how often it was interrupted, to the last bit.

    `info` of the Tally holds: `lost` (C,), what had not left after `max_order` events plus what leaked by rounding, so
    Σ reflected + Σ transmitted + absorbed + lost = 1; `leak_rate` per segment; `rays_per_second`, `segments_per_second`
    (tracing, scattering and tallying; a segment is one flight from facet to facet) and `seconds`; the measured
    `slopes`; the `configuration`.
    """
    require_numba()
    plan = Plan(surface, material, wi, **settings)
    plan.tracer.require()
    store = None if checkpoint is None else Checkpoint.open(Path(checkpoint), plan)
    total = plan.nothing()
    todo = distributed.share_of(take_finished(plan, store, total))
    rays = sum(shard.rays for shard in todo)
    with progress_bar("microsurface", rays, None if progress else False, unit="rays") as advance:
        clock = run_shards(plan, todo, total, threads=threads, store=store, advance=advance)
    distributed.add_up(total)
    clock.join()
    result = tally(plan, total)
    result.info.update(clock.report())
    return result


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
