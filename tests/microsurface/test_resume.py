"""Shards: killed runs go on, foreign checkpoints are refused, and any number of workers gives the same bits.

Real processes are started, killed with SIGKILL and started again.
"""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import soak
import torch

from torchms.microsurface import DielectricFacets, DiffuseFacets, GaussianSurfaces, GridTracer, MirrorFacets, simulate
from torchms.microsurface.simulation.checkpoint import differences

KEYS = ("reflected", "transmitted", "reflected_stderr", "transmitted_stderr", "lost", "slopes", "n", "segments")
OPTIONS = ("--material", "dielectric", "--alpha", "0.8", "--alpha-y", "0.3", "--theta", "1.1", "--phi", "0.4")
OPTIONS += ("--seed", "3", "--surfaces", "3", "--size", "128", "--tracer", "grid", "--no-progress")


def command(*options: str, workers: int = 0) -> list[str]:
    return soak.command([*OPTIONS, *options], workers)


def finish(*options: str, workers: int = 0) -> None:
    done = subprocess.run(
        command(*options, workers=workers), env=soak.environment(), capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-3000:]


def killed(folder: Path, rays: str, workers: int, out: Path) -> dict[str, int]:
    """Start, wait for a few shards, kill -9 one worker (or the only process), and return what is on disk."""
    process = subprocess.Popen(
        command("--rays", rays, "--checkpoint", str(folder), "--json", str(out), "--threads", "1", workers=workers),
        env=soak.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        until = time.monotonic() + 240
        while len(soak.shards(folder)) < 3:
            assert time.monotonic() < until and process.poll() is None, "no shards"
            time.sleep(0.02)
        os.kill(soak.children(process.pid)[-1] if workers else process.pid, signal.SIGKILL)
        assert process.wait(timeout=120) != 0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    assert not out.exists()
    return soak.shards(folder)


def expected(rays: float) -> dict:
    from torchms.maths.frame import direction

    tally = simulate(
        GaussianSurfaces(0.8, 0.3, count=3, size=128),
        DielectricFacets(1.5),
        direction(1.1, 0.4),
        n_rays=int(rays),
        seed=3,
        tracer=GridTracer(),
        lobes=False,
    )
    return {
        "reflected": tally.reflected[:, 0].tolist(),
        "transmitted": tally.transmitted[:, 0].tolist(),
        "reflected_stderr": tally.reflected_stderr[:, 0].tolist(),
        "transmitted_stderr": tally.transmitted_stderr[:, 0].tolist(),
        "lost": tally.info["lost"][0],
        "slopes": tally.info["slopes"],
        "n": tally.n,
        "segments": tally.info["segments"],
    }


def test_a_killed_run_loses_only_the_shards_in_flight(tmp_path: Path) -> None:
    rays, folder, out = "3e6", tmp_path / "shards", tmp_path / "out.json"
    left = killed(folder, rays, 0, out)
    assert 3 <= len(left) < 48
    finish("--rays", rays, "--checkpoint", str(folder), "--json", str(out))
    after = soak.shards(folder)
    assert len(after) == 48
    # What was on disk was taken, not traced again.
    assert {name: after[name] for name in left} == left
    assert not list(folder.glob(".*"))
    result = json.loads(out.read_text())
    assert {k: result[k] for k in KEYS} == expected(3e6)


@pytest.mark.slow
def test_a_killed_worker_of_torchrun_resumes_with_another_number_of_workers(tmp_path: Path) -> None:
    rays, folder, out = "5e6", tmp_path / "shards", tmp_path / "out.json"
    left = killed(folder, rays, 2, out)
    finish("--rays", rays, "--checkpoint", str(folder), "--json", str(out), workers=3)
    after = soak.shards(folder)
    assert {name: after[name] for name in left} == left
    result = json.loads(out.read_text())
    assert result["processes"] == 3
    assert {k: result[k] for k in KEYS} == expected(5e6)


def test_two_workers_give_the_bits_of_one(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    finish("--rays", "3e5", "--json", str(out), workers=2)
    result = json.loads(out.read_text())
    assert result["processes"] == 2
    assert {k: result[k] for k in KEYS} == expected(3e5)


def run(folder: Path | None, **change):
    arguments = dict(
        surface=GaussianSurfaces(0.8, count=2, size=128),
        material=DiffuseFacets(0.9),
        wi=(0.6, 0.0, 0.8),
        n_rays=4000,
        max_order=4,
        seed=1,
        tracer=GridTracer(),
        checkpoint=folder,
        rays_per_shard=500,
    )
    return simulate(**(arguments | change))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (dict(seed=2), "seed = 1 where this run has 2"),
        (dict(max_order=5), "max_order = 4 where this run has 5"),
        (dict(material=DiffuseFacets(0.8)), r"material.albedo = \[0.9\] where this run has \[0.8\]"),
        (dict(material=MirrorFacets()), "material.material = Lambertian where this run has Mirror"),
        (dict(surface=GaussianSurfaces(0.7, count=2, size=128)), "surface.alpha = 0.8 where this run has 0.7"),
        (dict(wi=(0.0, 0.0, 1.0)), "wi = "),
        (dict(lobes=False), "lobes = True where this run has False"),
    ],
)
def test_another_configuration_is_refused_and_the_difference_named(tmp_path: Path, change: dict, named: str) -> None:
    run(tmp_path)
    with pytest.raises(ValueError, match=named):
        run(tmp_path, **change)


def test_all_shards_from_disk_are_the_same_result(tmp_path: Path) -> None:
    first, again, plain = run(tmp_path), run(tmp_path), run(None)
    for other in (again, plain):
        assert torch.equal(first.reflected, other.reflected)
        assert torch.equal(first.reflected_stderr, other.reflected_stderr)
        assert first.lobes is not None and other.lobes is not None
        assert torch.equal(first.lobes.mean, other.lobes.mean)
        assert first.info["slopes"] == other.info["slopes"]
    assert again.info["rays_per_second"] == 0


def test_a_torn_shard_is_traced_again(tmp_path: Path) -> None:
    first = run(tmp_path)
    torn = sorted(tmp_path.glob("shard-*.npz"))[2]
    torn.write_bytes(torn.read_bytes()[:100])
    with pytest.warns(UserWarning, match=torn.name):
        again = run(tmp_path)
    assert torch.equal(first.reflected, again.reflected)
    with np.load(torn, allow_pickle=False) as file:
        assert file["counts"].shape == (1, 5)


def test_no_directory_no_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="must be a directory"):
        run(tmp_path / "file")
    run(tmp_path / "made" / "here")
    (tmp_path / "made" / "here" / "configuration.json").unlink()
    with pytest.raises(ValueError, match=r"no configuration\.json"):
        run(tmp_path / "made" / "here")


def test_differences_are_found_at_any_depth() -> None:
    a = {"x": {"y": 1, "z": [1, 2]}, "w": 0}
    assert differences(a, a) == []
    assert differences(a, {"x": {"y": 2, "z": [1, 2]}, "v": 5}) == [
        ("x.y", 1, 2),
        ("w", 0, "nothing"),
        ("v", "nothing", 5),
    ]
