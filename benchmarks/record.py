"""What every benchmark's JSON says about where its numbers come from, and how a call is timed."""

import os
import platform
import re
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchms
from torchms.storage.write import write_json

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


def save(name: str, rows: list[dict[str, Any]], out: Path | None = None) -> None:
    """Write `results/<name>.json`, or `out`."""
    write_json(out or RESULTS / f"{name}.json", {"birth": birth_certificate(), "rows": rows}, force=True)
