"""benchmarks/soak.py in a few seconds: processes forked from this one, so that starting again costs nothing."""

import json
import random
import shutil
import time
from pathlib import Path

import pytest
import soak
import tyro
from forked import Forked

from torchms.cli.options import SimulateOptions
from torchms.cli.simulate import run_simulate

SIMULATION = "--material dielectric --alpha 0.8 --alpha-y 0.3 --theta 1.1 --seed 3 --surfaces 2 --size 128 --rays 1e6"
OPTIONS = [*SIMULATION.split(), "--tracer", "grid", "--threads", "1", "--no-progress", "--force"]


def run(options: list[str]) -> None:
    run_simulate(tyro.cli(SimulateOptions, args=options))


def begin(options: list[str], workers: int) -> Forked:
    assert not workers
    return Forked(lambda: run(options))


@pytest.fixture
def calm(tmp_path: Path) -> tuple[Path, float]:
    """The result that nobody disturbed, and its seconds of computing."""
    path = tmp_path / "calm.json"
    run([*OPTIONS, *soak.outputs(path)])
    clock = time.process_time()
    run([*OPTIONS, *soak.outputs(path)])
    return path, time.process_time() - clock


def test_killed_at_random_times(tmp_path: Path, calm: tuple[Path, float], seed: int) -> None:
    path, seconds = calm
    folder, torn = tmp_path / "shards", tmp_path / "disturbed.json"
    options = [*OPTIONS, *soak.outputs(torn)]
    until = time.monotonic() + 40
    found = soak.disturbed(options, folder, random.Random(seed), gap=seconds / 8, until=until, begin=begin)
    assert found.kills.total() >= 5 and found.kills_while_tracing >= 1, found
    assert found.taken_from_disk >= 1 and not found.written_again, found
    assert len(found.shards) == 16 and soak.same(torn, path)
    # What a kill left half written is gone: there is never more of it than one start leaves.
    assert not soak.parts(folder) and found.most_left_half_written <= 1
    # Were shards not taken from disk, the numbers of another one in a shard's place would change nothing.
    one, other = sorted(folder.glob("shard-*.npz"))[:2]
    shutil.copy(other, one)
    run([*options, "--checkpoint", str(folder)])
    assert not soak.same(torn, path)
    assert json.loads(torn.read_text())["n"] == json.loads(path.read_text())["n"]
