"""What every benchmark's JSON says about where its numbers come from, and how a call is timed."""

import platform
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchms
from torchms.storage.write import write_json

RESULTS = Path(__file__).parent / "results"


def birth_certificate() -> dict[str, Any]:
    """Machine, versions and commit."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=RESULTS.parent, capture_output=True, text=True, check=False
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


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    names = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor()


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
    RESULTS.mkdir(exist_ok=True)
    write_json(out or RESULTS / f"{name}.json", {"birth": birth_certificate(), "rows": rows}, force=True)
