"""What goes wrong outside: damaged files, full disks, folders that cannot be written, two writers, an interrupt."""

import io
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import time
import warnings
import zipfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from importlib import resources
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
import torch
from hostile import FLIPS, TRUNCATIONS, damaged

from torchms.approximations import AlbedoTable
from torchms.microsurface import DiffuseFacets, GaussianSurfaces, simulate
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.storage import write as files
from torchms.storage.archives import read_arrays
from torchms.storage.write import check_writable, write_whole


def test_damaged_albedo_tables(tmp_path, messages, seed):
    """Refused by ValueError, or the very same numbers (a bit of a date, say, is nobody's business)."""
    good = resources.files("torchms.approximations").joinpath("ggx.npz").read_bytes()
    right = AlbedoTable.packaged("GGX")
    path = tmp_path / "table.npz"
    refused = 0
    for content in damaged(good, seed):
        path.write_bytes(content)
        try:
            table = AlbedoTable.load(path)
        except ValueError as error:
            assert "table.npz" in str(error) or "AlbedoTable" in str(error)
            refused += 1
            continue
        assert all(torch.equal(a, b) for a, b in zip(table.buffers(), right.buffers(), strict=True))
    assert refused > (TRUNCATIONS + FLIPS) / 2


def test_damaged_shards_are_traced_again(tmp_path, seed):
    """A damaged checkpoint never raises and never changes a result: what cannot be read is traced again."""

    def run() -> torch.Tensor:
        surface = GaussianSurfaces(0.8, count=1, size=128)
        arguments = dict(n_rays=400, max_order=2, seed=1, tracer=GridTracer(), lobes=False, rays_per_shard=200)
        return simulate(surface, DiffuseFacets(0.9), (0.6, 0.0, 0.8), checkpoint=tmp_path, **arguments).reflected

    right = run()
    shard = sorted(tmp_path.glob("shard-*.npz"))[0]
    good = shard.read_bytes()
    for content in damaged(good, seed, 12, 48):
        shard.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            assert torch.equal(run(), right)


def test_no_array_is_allocated_before_its_size_is_known(tmp_path):
    """A header that promises 8 TB, an archive that unpacks to too much, and one of objects."""
    path = tmp_path / "bomb.npz"
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", member.getvalue() + bytes(56))
    with pytest.raises(
        ValueError, match=r"x\.npy says that it is \(1000000000000,\) of float64, which is not its size"
    ):
        read_arrays(path, 1 << 20)
    np.savez_compressed(path, x=np.zeros(1 << 20))
    with pytest.raises(ValueError, match="would unpack to 8388"):
        read_arrays(path, 1 << 20)
    np.savez(path, x=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="unpickled"):
        read_arrays(path, 1 << 20)


# Output.


def in_child(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("limit", [0, 1, 4096, 99_999])
def test_a_full_disk_leaves_what_was_there(limit, tmp_path):
    """A file may grow to `limit` bytes: OSError, the old file whole, no part of the new one."""
    path = tmp_path / "result.bin"
    path.write_bytes(b"old")
    done = in_child(
        """
        import resource, signal, sys
        from torchms.storage.write import write_whole
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
        try:
            write_whole(sys.argv[1], b"x" * 100_000, force=True)
        except OSError as error:
            print("OSError", error.errno)
        """,
        path,
        limit,
    )
    assert done.stdout.startswith("OSError"), done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["result.bin"] and path.read_bytes() == b"old"


@pytest.mark.usefixtures("messages")
def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    """Said before the work, by name. (For the superuser every folder can be written: its answer is put in.)"""
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError, match=r"locked.*cannot be written"):
        check_writable(folder / "a.json", False)
    with pytest.raises(FileNotFoundError, match="Make it first"):
        check_writable(tmp_path / "none" / "a.json", False)
    folder.chmod(0o700)
    with pytest.raises(OSError):
        write_whole(Path("/proc/self/a.bin"), b"x")


def _write_many(path: Path, letter: bytes) -> None:
    for _ in range(100):
        write_whole(path, letter * 50_000, force=True)


def test_two_processes_on_one_output(tmp_path):
    """200 writes by two processes, read all the while: always the one or the other, whole."""
    path = tmp_path / "shared.bin"
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
        jobs = [pool.submit(_write_many, path, letter) for letter in (b"a", b"b")]
        reads = 0
        while not all(job.done() for job in jobs):
            if path.exists():
                content = path.read_bytes()
                assert len(content) == 50_000 and len(set(content)) == 1
                reads += 1
        for job in jobs:
            job.result()
    assert reads > 10 and [p.name for p in tmp_path.iterdir()] == ["shared.bin"]


def heed_interrupts() -> None:
    """In a child: SIGINT interrupts it, even if the suite runs in the background of a shell, where it is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.013, 0.05])
def test_an_interrupt_leaves_no_part(delay, tmp_path):
    """SIGINT while files are written one after the other: each is whole or absent, and nothing else is there."""
    program = """
        import sys
        from pathlib import Path
        from torchms.storage.write import write_whole
        print("ready", flush=True)
        for i in range(100_000):
            write_whole(Path(sys.argv[1]) / f"{i}.bin", bytes(200_000))
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program), str(tmp_path)],
        preexec_fn=heed_interrupts,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) != 0
    process.stdout.close()
    found = list(tmp_path.iterdir())
    assert all(p.name.endswith(".bin") and not p.name.startswith(".") for p in found), [p.name for p in found]
    assert all(p.stat().st_size == 200_000 for p in found)


def test_an_interrupt_at_any_instruction(tmp_path):
    """Instead of at random times: at every instruction of the writer, one after the other."""
    left, instruction, outside = 0, 0, sys.gettrace()

    def step(frame: FrameType, event: str, argument: object) -> Callable[..., object] | None:
        nonlocal left
        if (frame.f_code.co_filename, frame.f_code.co_name) != (files.__file__, "_written"):
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
        return step

    for instruction in range(1, 1000):
        left = instruction
        sys.settrace(step)
        try:
            write_whole(tmp_path / "a.bin", b"content", force=True)
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(outside)
        assert {p.name for p in tmp_path.iterdir()} <= {"a.bin"}, instruction
        if left > 0:
            break
    assert 20 < instruction < 999 and (tmp_path / "a.bin").read_bytes() == b"content"


@pytest.mark.slow
def test_an_interrupted_command_leaves_nothing(tmp_path):
    """`torchms simulate --json` stopped by SIGINT: no result, no part of one, a code that says so."""
    out = tmp_path / "out.json"
    options = [
        "--alpha",
        "0.6",
        "--theta",
        "1.1",
        "--rays",
        "1e9",
        "--tracer",
        "grid",
        "--size",
        "128",
        "--no-progress",
    ]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "torchms",
            "simulate",
            *options,
            "--checkpoint",
            str(tmp_path / "shards"),
            "--json",
            str(out),
        ],
        preexec_fn=heed_interrupts,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    until = time.monotonic() + 90
    while not list((tmp_path / "shards").glob("shard-*")):
        assert time.monotonic() < until and process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode != 0, errors
    assert not out.exists() and not list(tmp_path.glob("shards/.*"))
    assert json.loads((tmp_path / "shards" / "configuration.json").read_text())
