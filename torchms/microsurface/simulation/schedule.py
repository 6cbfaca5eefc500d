"""Shards on the threads of this process, each kept the moment it is finished, and the time that takes."""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import groupby

from torchms.evaluation.workers import Workers
from torchms.microsurface.simulation import distributed
from torchms.microsurface.simulation.checkpoint import Checkpoint
from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Plan, Shard
from torchms.microsurface.simulation.tracing import run_surface


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
    advance: Callable[[int], None] = lambda rays: None,
) -> Clock:
    """Trace the shards of `todo` and add them to `total`; each is stored the moment it is finished."""
    n = checked_threads(threads)
    distributed.wait_for_all()
    clock = Clock()

    def finish(done: Future, shard: Shard) -> None:
        found = done.result()
        if store is not None:
            store.save(shard, found)
        total.add(found, plan.group(shard), shard.surface)
        clock.rays += int(found.counts[0, 0])
        clock.segments += int(found.counts[0, 1])
        advance(shard.rays)

    with Workers(n) as workers:

        def run(trace: Callable[[Shard], Partial], shards: Sequence[Shard]) -> None:
            clock.surfaces += time.perf_counter() - begin
            start = time.perf_counter()
            waiting: dict[Future, Shard] = {}
            queue = iter(shards)
            while True:
                # Few results wait at a time: memory is bounded however many shards there are.
                while len(waiting) < 2 * n and (shard := next(queue, None)) is not None:
                    waiting[workers.submit(trace, shard)] = shard
                if not waiting:
                    break
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    finish(future, waiting.pop(future))
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
