"""Speed of the microsurface simulator, both tracers, against the number of triangles; and what bounds it.

    python benchmarks/microsurface_speed.py [--rays 4e6] [--sizes 708 1024 1414 2828] [--out ...json] [--force]

Mirror facets (F = 1), Beckmann, lobes tallied; everything counts (launch, trace, scatter, tally) but the making of the
surface. Wall clock holds on a quiet machine only; segments per CPU second hold roughly on a busy one, too. The parts
are timed one after the other in one thread, as shares of its CPU time.
"""

import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from torchms.maths.frame import direction
from torchms.microsurface import EmbreeTracer, GridTracer, Heightfield, MirrorFacets
from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.rays.tracer import Caster, Tracer
from torchms.microsurface.simulation.launch import launch
from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Plan
from torchms.microsurface.simulation.schedule import run_shards
from torchms.microsurface.simulation.settle import settle
from torchms.microsurface.simulation.tracing import run_shard
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

TRACERS: tuple[Tracer, ...] = (EmbreeTracer(), GridTracer())


@dataclass
class Options:
    """Measure the simulator's speed."""

    rays: float = 2e6
    """Light paths a measurement."""
    sizes: tuple[int, ...] = (708, 1024, 1414, 2828)
    """Texels along an edge: 1, 2.1, 4 and 16 million triangles."""
    alpha: float = 0.5
    """Roughness."""
    thetas: tuple[float, ...] = (0.5, 1.5)
    """Angles of incidence [rad]."""
    threads: int = 2
    """Threads."""
    repeats: int = 3
    """Measurements, of which the median counts."""
    out: Path = Path(__file__).parent / "results" / "microsurface_speed.json"
    """Where the numbers go."""
    force: bool = False
    """Overwrite them."""


def parts(grid: Grid, caster: Caster, wi: np.ndarray, n: int = 65536) -> dict[str, float]:
    """Share of a thread's CPU time that goes into each stage, over paths of up to 10 events."""
    spent: dict[str, float] = {"launch": 0.0, "trace": 0.0, "scatter": 0.0, "tally": 0.0}
    found, p, key = Partial.zeros(1, 1, 10, 1, True), Paths.empty(n, 1, False), np.array([1, 2], dtype=np.uint32)
    place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
    energies = (found.reflected[0], found.transmitted[0], found.leaked[0], found.lobes[0])

    def timed(stage: str, function: Any, *arguments: Any) -> Any:
        start = time.thread_time()
        result = function(*arguments)
        spent[stage] += time.thread_time() - start
        return result

    p.n = n
    timed("launch", launch, 0, n, key, wi, *grid.heights.shape, grid.launch_height, *place, n)
    for event in range(11):
        if event:
            timed("scatter", MirrorFacets().scatter, p, grid, event, key, False)
        timed("trace", caster.cast, p)
        p.n = timed("tally", settle, event, np.ones(1), False, p.weight, *energies, *place, p.n)
        if not p.n:
            break
    return {stage: seconds / sum(spent.values()) for stage, seconds in spent.items()}


def measured(surface: Heightfield, grid: Grid, tracer: Tracer, theta: float, options: Options) -> dict[str, Any]:
    """Speeds of one tracer on one surface at one angle."""
    wi = direction(theta).numpy()
    plan = Plan(surface, MirrorFacets(), wi, n_rays=options.rays, seed=1, tracer=tracer)
    wall = [
        run_shards(plan, plan.shards, plan.nothing(), threads=options.threads).report() for _ in range(options.repeats)
    ]
    caster = tracer.bind(grid)
    # Processor time of the tracing alone: once more, in one thread.
    shard = plan.shards[0]
    start = time.process_time()
    found = run_shard(plan, shard, grid, caster.fork(), np.zeros(4))
    alone = time.process_time() - start
    rays, segments = (np.array([w[f"{what}_per_second"] for w in wall], dtype=float) for what in ("rays", "segments"))
    return {
        "tracer": tracer.describe()["tracer"],
        "theta": theta,
        "triangles": surface.n_triangles,
        "segments_per_ray": int(found.counts[0, 1]) / shard.rays,
        "casts_per_segment": int(found.counts[0, 2]) / int(found.counts[0, 1]),
        "rays_per_second": float(np.median(rays)),
        "segments_per_second": float(np.median(segments)),
        "segments_per_second_range": [float(segments.min()), float(segments.max())],
        "segments_per_cpu_second": int(found.counts[0, 1]) / alone,
        "leak_rate": int(found.counts[0, 4]) / int(found.counts[0, 1]),
        "parts": parts(grid, caster.fork(), wi),
    }


def main(options: Options) -> None:
    check_writable(options.out, options.force)
    rows, building = [], []
    for size in options.sizes:
        surface = Heightfield.gaussian(options.alpha, size=size, seed=1)
        grid = Grid.of(surface)
        for tracer in TRACERS:
            start = time.process_time()
            tracer.bind(grid)
            building.append([tracer.describe()["tracer"], surface.n_triangles, time.process_time() - start])
            for theta in options.thetas:
                rows.append(measured(surface, grid, tracer, theta, options))
                print(rows[-1], flush=True)
    content = {
        "command": f"python benchmarks/microsurface_speed.py --rays {options.rays:g} --threads {options.threads}",
        "version": __version__,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load": os.getloadavg(),
        "alpha": options.alpha,
        "building_cpu_seconds": building,
        "rows": rows,
    }
    write_json(options.out, content, options.force)
    table = Table(title=f"Microsurface simulator, {options.threads} threads, mirror facets, alpha {options.alpha:g}")
    for heading in ("tracer", "triangles", "theta", "M rays/s", "M segments/s", "M segments/CPU-s", "trace share"):
        table.add_column(heading, justify="right")
    for r in rows:
        speeds = (r["rays_per_second"], r["segments_per_second"], r["segments_per_cpu_second"])
        cells = [f"{v / 1e6:.2f}" for v in speeds]
        table.add_row(
            r["tracer"], f"{r['triangles']:,}", f"{r['theta']:g}", *cells, f"{100 * r['parts']['trace']:.0f} %"
        )
    Console(width=110).print(table)


if __name__ == "__main__":
    main(tyro.cli(Options))
