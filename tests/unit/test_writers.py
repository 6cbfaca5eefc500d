"""Everything that writes a file, under every fault: what it leaves is whole or not there."""

import json
import os
import random
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from forked import Forked
from matplotlib.backends import backend_agg, backend_svg

import export.__main__ as exporting
from tools import generate_metals, generate_tables
from torchms import cli
from torchms.cli import energy, figures, render
from torchms.cli import export as command
from torchms.microsurface import Heightfield
from torchms.onnx import exporter
from torchms.onnx.parity import compare, table
from torchms.render.images import read_picture
from torchms.storage.media import read_mesh
from torchms.testing import chi_square

pytestmark = pytest.mark.usefixtures("messages")
CANNED = bytes(range(256)) * 400
"""In place of what takes long to compute (ONNX files, tables); the way to the disk is the real one."""

SURFACE = "--size 128 --surfaces 2 --tracer grid --max-order 2"
MIRROR = "RoughConductor(GGX(0.5),Ideal(),SingleBounce())"


def torchms(line: str) -> Callable[[Path], int]:
    """A command of `torchms`; {out} is the folder."""
    return lambda out: cli.main([word.replace("{out}", str(out)) for word in line.split()])


def script(main: Callable[[], object], *options: str) -> Callable[[Path], object]:
    """A program of its own."""

    def run(out: Path) -> object:
        sys.argv = ["program", *(option.replace("{out}", str(out)) for option in options)]
        return main()

    return run


def tables(out: Path) -> None:
    generate_tables.FOLDER = out
    generate_tables.main(["GGX"])


def metals(out: Path) -> None:
    class Package(ModuleType):
        files = staticmethod(lambda name: out)

    generate_metals.resources = Package("resources")
    generate_metals.main()


def picture(out: Path) -> None:
    """What `law_suite(picture=...)` draws, too."""
    w = torch.zeros(500, 3)
    w[:, 2] = 1
    chi_square(w, lambda w: torch.full(w.shape[:-1], 0.25 / torch.pi, dtype=w.dtype), (8, 8), picture=out / "chi.png")


WRITERS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "simulate": (
        torchms(
            f"simulate --rays 400 {SURFACE} --threads 1 --no-progress --force --json {{out}}/a.json --lobes {{out}}/a.npz"
        ),
        ("a.json", "a.npz"),
    ),
    "energy": (
        torchms("energy --theta 0.5 --samples 200 --max-order 2 --models height-walk --force --json {out}/a.json"),
        ("a.json",),
    ),
    "figures": (
        torchms(f"figures --rays 400 --walks 200 --theta 0.5 {SURFACE} --out {{out}} --force"),
        ("conductor_a0.5.png", "conductor_a0.5.svg", "conductor_a0.5.json"),
    ),
    "render": (
        torchms(
            f"render slab --bsdf {MIRROR} --width 8 --height 8 --samples 2 --force --out {{out}}/a.png --stderr {{out}}/a.exr"
        ),
        ("a.png", "a.exr"),
    ),
    "export": (torchms("export {out}/a.onnx --scattering single-bounce --force"), ("a.onnx",)),
    "python -m export": (
        script(
            exporting.main,
            *[
                "--out",
                "{out}",
                "--materials",
                "conductor",
                "--distributions",
                "ggx",
                "--what",
                "pdf",
                "--rows",
                "64",
                "--force",
            ],
        ),
        ("conductor-ggx-pdf.onnx",),
    ),
    "Heightfield.export": (
        lambda out: Heightfield.gaussian(0.1, size=96, texels_per_correlation=6, seed=1).export(
            out / "a.ply", force=True
        ),
        ("a.ply",),
    ),
    "generate_tables": (tables, ("ggx.npz",)),
    "generate_metals": (metals, ("metals.json",)),
    "chi_square": (picture, ("chi.png",)),
}


COMMANDS = {"simulate", "energy", "figures", "render", "export", "python -m export"}
"""Writers that say in one line what is wrong, with code 2; the others raise."""

PRELOADED = (energy, figures, render, backend_agg, backend_svg)
"""Loaded before the fork."""


@pytest.fixture(params=WRITERS)
def writer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a writer; programs of minutes give canned bytes."""
    for module in (command, exporter):
        monkeypatch.setattr(module, "exported", lambda *arguments, **named: CANNED)
    monkeypatch.setattr(compare, "check", lambda *arguments: None)
    monkeypatch.setattr(table.Entry, "of", lambda name, *arguments: table.Entry(name, refused="canned"))
    monkeypatch.setattr(generate_tables, "generated", lambda name: CANNED)
    monkeypatch.setattr(generate_metals, "generate", lambda: {"metals": ["x" * 100] * 1000})
    return request.param


def start(name: str, out: Path, before: Callable[[], object] = lambda: None) -> Forked:
    """The writer in a process of its own, after `before`."""

    def work() -> object:
        before()
        return WRITERS[name][0](out)

    return Forked(work)


def is_whole(path: Path) -> bool:
    """Whether the file can be read to its end."""
    content = path.read_bytes()
    if content == CANNED:
        return True
    if path.suffix == ".json":
        json.loads(content)
    elif path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return all(file[name].size for name in file.files)
    elif path.suffix in (".png", ".exr"):
        return read_picture(path).numel() > 0
    elif path.suffix == ".ply":
        return len(read_mesh(path).faces) == 2 * 96 * 96
    else:
        return content.rstrip().endswith(b"</svg>")
    return True


def check_folder(name: str, out: Path, old: bytes | None = None) -> int:
    """Only files of this writer, each whole (or as it was); how many are new."""
    files = list(out.iterdir())
    assert {path.name for path in files} <= set(WRITERS[name][1])
    new = [path for path in files if path.read_bytes() != old]
    assert all(is_whole(path) for path in new)
    return len(new)


def test_a_full_disk(writer: str, tmp_path: Path) -> None:
    """A file may grow no further than a byte below its size: the old one stays, and a command says why."""
    names, old = WRITERS[writer][1], b"old"
    assert start(writer, tmp_path).wait() == 0
    assert check_folder(writer, tmp_path) == len(names)
    most = max((tmp_path / name).stat().st_size for name in names)
    for name in names:
        (tmp_path / name).write_bytes(old)
    code = start(writer, tmp_path, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most - 1, most - 1))).wait()
    assert code == (2 if writer in COMMANDS else 1)
    assert check_folder(writer, tmp_path, old) < len(names)


def test_a_folder_that_cannot_be_written(writer: str, tmp_path: Path) -> None:
    """A file where the folder should be, and one in which even the superuser makes no file."""
    path = tmp_path / "file"
    path.write_bytes(b"mine")
    for out in (path, path / "below", Path("/proc/self/fdinfo")):
        assert start(writer, out).wait() == (2 if writer in COMMANDS else 1)
    assert [p.name for p in tmp_path.iterdir()] == ["file"] and path.read_bytes() == b"mine"


OFTEN = pytest.mark.parametrize("times", [1, pytest.param(10, marks=pytest.mark.slow)])


@OFTEN
def test_two_at_once(writer: str, times: int, tmp_path: Path) -> None:
    """Both finish, and what is there is whole."""
    for _ in range(times):
        both = [start(writer, tmp_path) for _ in range(2)]
        assert [process.wait() for process in both] == [0, 0]
        assert check_folder(writer, tmp_path) == len(WRITERS[writer][1])


@OFTEN
def test_interrupts(writer: str, times: int, tmp_path: Path, seed: int) -> None:
    """SIGINT at random times, from before the work to after it."""
    rng = random.Random(seed)
    begin = time.monotonic()
    assert start(writer, tmp_path).wait() == 0
    seconds = time.monotonic() - begin
    for _ in range(3 * times):
        for path in tmp_path.iterdir():
            path.unlink()
        process = start(writer, tmp_path, lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
        time.sleep(rng.uniform(0.0, seconds))
        if process.poll() is None:
            os.kill(process.pid, signal.SIGINT)
        code = process.wait()
        assert check_folder(writer, tmp_path) == len(WRITERS[writer][1]) or code in (1, 130, -signal.SIGINT)
