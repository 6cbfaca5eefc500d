"""What every benchmark's JSON says about where its numbers come from, and how a call is timed."""

import contextlib
import functools
import os
import platform
import re
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch

import torchms
from torchms.evaluation import engine
from torchms.machine import build
from torchms.storage.write import write_json

REPEATS = 7
HOME = Path(__file__).parent / "results"
"""Of the machine in its file `machine`, whose numbers the pages show; those of others go into a folder of their own there."""


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def machine() -> str:
    """Processor, its vectors and number of cores, as the name of a folder: processors of one name may differ by half."""
    vectors = torch.backends.cpu.get_cpu_capability()
    return re.sub(r"[^a-z0-9]+", "-", f"{_cpu()} {vectors} {os.cpu_count()} cores".lower()).strip("-")


def results(home: Path = HOME) -> Path:
    """Where the numbers of this machine go; the folder is made."""
    known = home / "machine"
    folder = home if known.exists() and known.read_text().strip() == machine() else home / machine()
    folder.mkdir(parents=True, exist_ok=True)
    return folder


RESULTS = results()


def birth_certificate() -> dict[str, Any]:
    """Machine, versions and commit."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=HOME.parent, capture_output=True, text=True, check=False
    )
    return {
        "machine": platform.machine(),
        "cpu": _cpu(),
        "threads": torch.get_num_threads(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "torchms": torchms.__version__,
        "commit": commit.stdout.strip() or None,
    }


def seconds(call: Callable[[], Any], repetitions: int = 7) -> dict[str, float]:
    """Median and quartiles of the time of `call` [s], after one warm-up."""
    call()
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    low, median, high = np.percentile(times, [25, 50, 75])
    return {"median": float(median), "q25": float(low), "q75": float(high)}


def timed(*calls: Callable[[], Any], repeats: int | None = None) -> list[float]:
    """Median seconds of each call; the calls take turns, after one warm-up."""
    times: list[list[float]] = [[] for _ in calls]
    for call in calls:
        call()
    for _ in range(repeats or REPEATS):
        for call, found in zip(calls, times, strict=True):
            start = time.perf_counter()
            call()
            found.append(time.perf_counter() - start)
    return [statistics.median(found) for found in times]


def first_call(call: Callable[[], Any]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


@contextlib.contextmanager
def compiled_anew() -> Iterator[None]:
    """Nothing that was compiled before serves inside, and nothing of it is kept."""
    with tempfile.TemporaryDirectory() as place, mock.patch.object(build, "folder", functools.partial(Path, place)):
        engine._programs.clear()
        yield


def save(name: str, rows: list[dict[str, Any]], out: Path | None = None) -> None:
    """Write `results/<name>.json`, or `out`."""
    write_json(out or RESULTS / f"{name}.json", {"birth": birth_certificate(), "rows": rows}, force=True)
