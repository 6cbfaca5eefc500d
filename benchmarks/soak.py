"""A simulation that is killed (SIGKILL) again and again and started again: the same bits as one left in peace?

Each round is a simulation of its own. Its starts, one process or now and then two under torchrun, end by a kill
  clock     at a random time (exponential, of its own computing time), so that it may hit anything;
  start-up  in the first seconds, before anything is traced;
  write     while a shard stands half written beside its name;
  shard     the moment a shard is there, between one and the next;
until one of them is done. Then the same simulation runs once without a checkpoint, and all numbers are compared.

    python benchmarks/soak.py --minutes 60    # and as long again for the calm runs, at most; JSON after each round
"""

import argparse
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
KINDS = {"clock": 6, "start-up": 2, "write": 3, "shard": 1}
"""Kinds of kills, and how often each is drawn."""

ROUNDS = (
    "--material dielectric --alpha 0.8 --alpha-y 0.3 --theta 1.1 --phi 0.4",
    "--material conductor --metal Au --alpha 0.5 --theta 0.7",
    "--material diffuse --albedo 0.8 --alpha 0.6 --theta 1.4 --phi 2.0",
)
SURFACES = "--surfaces 8 --size 256 --tracer grid --threads 1 --no-progress"
TIMES = ("options", "processes", "rays_per_second", "segments_per_second", "seconds")
"""What may differ between two runs of one simulation."""


class Running(Protocol):
    """A process."""

    pid: int

    def poll(self) -> int | None: ...
    def wait(self, timeout: float | None = None) -> int: ...


Start = Callable[[list[str], int], Running]
"""Starts `torchms simulate` with these options, by so many workers of torchrun (0: without it)."""


def environment() -> dict[str, str]:
    """One thread a process; nothing of a test run around it."""
    keep = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "COV_"))}
    return keep | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}


def command(options: list[str], workers: int = 0) -> list[str]:
    """Command line of one start."""
    launcher = [sys.executable]
    if workers:
        launcher += ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={workers}"]
    return [*launcher, "-m", "torchms", "simulate", *options]


def start(options: list[str], workers: int) -> Running:
    """A new process; what it says goes nowhere."""
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command(options, workers), env=environment(), stdout=quiet, stderr=quiet)


def children(pid: int) -> list[int]:
    """Processes that a process started."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def computed(process: Running) -> float:
    """Seconds of computing that a process and its children have done: a busy machine changes nothing about it."""
    ticks = 0
    for pid in [process.pid, *children(process.pid)]:
        with suppress(FileNotFoundError):  # a child has ended
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def kill(process: Running, one_worker: bool = False) -> None:
    """SIGKILL to all of it (the launcher is stopped first, so that it starts nothing more), or to a worker alone."""
    if one_worker and (workers := children(process.pid)):
        os.kill(workers[-1], signal.SIGKILL)
        process.wait(120)
        return
    os.kill(process.pid, signal.SIGSTOP)
    for pid in [*children(process.pid), process.pid]:
        os.kill(pid, signal.SIGKILL)
    process.wait()


def shards(folder: Path) -> dict[str, int]:
    """Finished shards and when each was written [ns]."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("shard-*.npz")}


def parts(folder: Path) -> list[str]:
    """Files that somebody is writing, or was writing when he was killed."""
    return [name for name in os.listdir(folder) if name.endswith(".part")] if folder.is_dir() else []


@dataclass
class Found:
    """What was counted over the starts of one simulation."""

    kills: Counter = field(default_factory=Counter)
    starts: int = 0
    starts_of_two_workers: int = 0
    taken_from_disk: int = 0
    """Shards that a start found there, over all starts."""
    kills_while_tracing: int = 0
    """Each lost the shards in flight, one a thread."""
    left_half_written: int = 0
    most_left_half_written: int = 0
    seconds: float = 0.0
    shards: dict[str, int] = field(default_factory=dict)
    written_again: int = 0
    """Finished shards that were not taken from disk: there should be none."""

    def row(self) -> dict[str, Any]:
        """As JSON."""
        return vars(self) | {"kills": dict(self.kills), "shards": len(self.shards)}


def disturbed(
    options: list[str], folder: Path, rng: random.Random, *, gap: float, until: float, begin: Start = start
) -> Found:
    """Run the simulation with its shards in `folder`, killed about every `gap` seconds of computing, until it is done.

    From the time `until` (of `time.monotonic`) on it is left alone. RuntimeError if it ends by itself in any other way.
    """
    found = Found()
    stale: set[str] = set()
    clock = time.monotonic()
    while True:
        workers = 2 if begin is start and rng.random() < 0.2 else 0
        found.starts += 1
        found.starts_of_two_workers += workers == 2
        found.taken_from_disk += len(found.shards)
        process = begin([*options, "--checkpoint", str(folder)], workers)
        kind = rng.choices(list(KINDS), list(KINDS.values()))[0]
        try:
            struck = time.monotonic() < until and strike(process, kind, folder, rng, gap, until)
            if struck:
                kill(process, one_worker=workers > 0 and rng.random() < 0.5)
            code = process.wait()
        finally:
            if process.poll() is None:
                kill(process)
        now = shards(folder)
        found.written_again += sum(now.get(name) != when for name, when in found.shards.items())
        if not struck:
            if code:
                raise RuntimeError(f"start {found.starts} ended with code {code}: {shlex.join(options)}")
            found.shards, found.seconds = now, time.monotonic() - clock
            return found
        found.kills[kind] += 1
        found.kills_while_tracing += len(now) > len(found.shards)
        left = set(parts(folder))
        found.left_half_written += len(left - stale)
        found.most_left_half_written = max(found.most_left_half_written, len(left))
        stale = left
        found.shards = now


def strike(process: Running, kind: str, folder: Path, rng: random.Random, gap: float, until: float) -> bool:
    """Wait for the moment of a kill of this kind; False if the process ended before, or nothing came until then."""
    moment = {"clock": rng.expovariate(1 / gap), "start-up": rng.uniform(0, gap / 2)}.get(kind, rng.uniform(0, gap))
    while process.poll() is None and computed(process) < moment:
        time.sleep(min(0.05, gap / 100))
    stale, before = set(parts(folder)), len(shards(folder))
    waiting = kind in ("write", "shard")
    while waiting and process.poll() is None and time.monotonic() < until:
        if not stale.issuperset(parts(folder)) if kind == "write" else len(shards(folder)) > before:
            break
        time.sleep(0.0005)
    return process.poll() is None


def same(a: Path, b: Path) -> bool:
    """Whether two results (JSON, and .npz beside it) have the same bits."""
    one, other = (json.loads(path.read_text()) for path in (a, b))
    with (
        np.load(a.with_suffix(".npz"), allow_pickle=False) as x,
        np.load(b.with_suffix(".npz"), allow_pickle=False) as y,
    ):
        lobes = x.files == y.files and all(np.array_equal(x[name], y[name]) for name in x.files)
    return lobes and all(one[key] == other[key] for key in one.keys() | other.keys() if key not in TIMES)


def outputs(path: Path) -> list[str]:
    """Options for the result at `path` and its lobes."""
    return ["--json", str(path), "--lobes", str(path.with_suffix(".npz"))]


def round_of(options: list[str], folder: Path, rng: random.Random, gap: float, until: float) -> dict[str, Any]:
    """One simulation disturbed, once more in peace, and the comparison."""
    calm, torn = folder / "calm.json", folder / "disturbed.json"
    found = disturbed([*options, *outputs(torn), "--force"], folder / "shards", rng, gap=gap, until=until)
    clock = time.monotonic()
    if code := start([*options, *outputs(calm)], 0).wait():
        raise RuntimeError(f"the undisturbed run ended with code {code}: {shlex.join(options)}")
    left = parts(folder / "shards") + parts(folder)
    peace = {"seconds_undisturbed": time.monotonic() - clock, "left_at_the_end": len(left), "same": same(torn, calm)}
    return {"options": shlex.join(options)} | found.row() | peace


def total(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Sums over the rounds."""
    kills = sum((Counter(row["kills"]) for row in rows), Counter())
    sums = {key: sum(row[key] for row in rows) for key, value in rows[0].items() if type(value) in (int, float)}
    return (
        {"rounds": len(rows), "kills": dict(kills), "all_kills": kills.total()}
        | sums
        | {
            "most_left_half_written": max(row["most_left_half_written"] for row in rows),
            "same": all(row["same"] for row in rows),
        }
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0, help="of disturbed running")
    parser.add_argument("--rays", type=float, default=2e7, help="of each simulation")
    parser.add_argument("--gap", type=float, default=5.0, help="seconds of computing between kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="JSON file instead of results/soak.json")
    parser.add_argument("--append", action="store_true", help="to the rounds that the JSON holds already")
    options = parser.parse_args()
    from record import RESULTS, save

    out = options.out or RESULTS / "soak.json"
    rows = json.loads(out.read_text())["rows"][1:] if options.append else []
    rng, disturbed_seconds = random.Random(options.seed), 0.0
    while disturbed_seconds < 60 * options.minutes:
        plan = f"{ROUNDS[len(rows) % len(ROUNDS)]} {SURFACES} --rays {options.rays} --seed {len(rows)}"
        until = time.monotonic() + 60 * options.minutes - disturbed_seconds
        with tempfile.TemporaryDirectory() as folder:
            rows.append(round_of(shlex.split(plan), Path(folder), rng, options.gap, until))
        disturbed_seconds += rows[-1]["seconds"]
        print(json.dumps(rows[-1]), flush=True)
        save("soak", [total(rows), *rows], out)
    print(json.dumps(total(rows)))
    return 0 if total(rows)["same"] else 1


if __name__ == "__main__":
    sys.exit(main())
