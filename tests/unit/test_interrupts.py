"""Ctrl-C ends long work at once, whatever its threads are at; what cannot end well is refused before it begins."""

import os
import signal
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest
from forked import Forked

from torchms import cli
from torchms.evaluation.workers import Workers
from torchms.lobes import measure
from torchms.microsurface.simulation import tracing
from torchms.render import film

for name in ("export", "figures", "render", "simulate"):  # loaded before the fork
    import_module(f"torchms.cli.{name}")

pytestmark = pytest.mark.usefixtures("messages")

SURFACE = "--size 128 --surfaces 2 --tracer grid --threads 1 --no-progress"
ENDLESS = {
    "render": (
        "render sphere --bsdf RoughConductor(GGX(0.5),Ideal(),SingleBounce()) --out {out}/a.png",
        film,
        "radiance",
    ),
    "energy": (
        "energy --theta 0.5 --models height-walk --samples 2e5 --json {out}/a.json",
        sys.modules[measure.__module__],
        "_walk_block",
    ),
    "simulate": (f"simulate {SURFACE} --rays 1e5 --json {{out}}/a.json", tracing, "run_shard"),
}
"""A command, and the work of its threads, which never ends here."""


def endless(began: Path):
    """Work of a thread that says that it began, and then goes on for ever."""

    def work(*arguments: object, **named: object) -> None:
        began.touch()
        while True:
            time.sleep(0.001)

    return work


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("name", ENDLESS)
def test_ctrl_c_ends_a_command(name: str, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once or twice: the code is 130, and no file is left. Without an end of the threads this would hang."""
    line, module, function = ENDLESS[name]
    out = tmp_path / "out"
    out.mkdir()
    began = tmp_path / "began"
    if name == "simulate":
        # The first run of a surface, in the main thread, only loads kernels.
        monkeypatch.setattr(tracing, "run_surface", lambda plan, shards, run: run(endless(began), shards))
        monkeypatch.setattr("torchms.microsurface.simulation.schedule.run_surface", tracing.run_surface)
    else:
        monkeypatch.setattr(module, function, endless(began))

    def work() -> int:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return cli.main([word.replace("{out}", str(out)) for word in line.split()])

    process = Forked(work)
    until = time.monotonic() + 120
    while not began.exists():
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.01)
    for _ in range(times):
        os.kill(process.pid, signal.SIGINT)
    code = process.wait(timeout=60)
    # A second one may come after the command has ended its work, when nothing catches it any more.
    assert code == 130 or (times == 2 and code in (1, -signal.SIGINT)), code
    assert not list(out.iterdir())


def test_workers_give_results_in_order() -> None:
    with Workers(3) as workers:
        assert list(workers.map(lambda i: i * i, range(20))) == [i * i for i in range(20)]


def test_an_error_of_one_ends_the_others() -> None:
    """A worker that catches the first exception it meets is told again."""
    told = []

    def stubborn(i: int) -> None:
        if i == 0:
            raise ValueError("the first")
        for _ in range(2):
            try:
                while True:
                    time.sleep(0.001)
            except BaseException:
                told.append(i)
        raise AssertionError

    with pytest.raises(ValueError, match="the first"), Workers(2) as workers:
        list(workers.map(stubborn, range(2)))
    assert told in ([], [1, 1])


MISSING = {
    "png": ("render sphere --out {out}/a.png", "PIL", "Pillow"),
    "exr": ("render sphere --out {out}/a.exr", "OpenEXR", "OpenEXR"),
    "error of the pixels": ("render sphere --out {out}/a.png --stderr {out}/b.exr", "OpenEXR", "OpenEXR"),
    "simulate": (f"simulate {SURFACE}", "numba", "numba"),
    "embree": ("simulate --size 128 --surfaces 2", "embreex.mesh_construction", "embreex"),
    "figures": ("figures --out {out}", "matplotlib", "matplotlib"),
    "export": ("export {out}/a.onnx --check", "onnxruntime", "onnxruntime"),
}


def refuse(*arguments: object, **named: object) -> None:
    raise AssertionError("the work has begun")


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever takes long fails."""
    for target in ("film.radiance",):
        monkeypatch.setattr(f"torchms.render.{target}", refuse)
    monkeypatch.setattr("torchms.microsurface.simulation.schedule.run_surface", refuse)
    monkeypatch.setattr("torchms.onnx.exporter.traced", refuse)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("name", MISSING)
def test_a_missing_extra_is_named_before_the_work(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line, module, word = MISSING[name]
    monkeypatch.setitem(sys.modules, module, None)
    assert cli.main([part.replace("{out}", str(tmp_path)) for part in line.split()]) == 2
    assert word in capsys.readouterr().err and not list(tmp_path.iterdir())


PLACES = {
    "a folder": "{out}",
    "no folder": "{out}/none/a.{suffix}",
    "no place for files": "/proc/self/fdinfo/a.{suffix}",
}
OUTPUTS = {
    "render": ("render sphere --force --out {place}", "png"),
    "export": ("export {place} --force", "onnx"),
    "simulate": (f"simulate {SURFACE} --force --json {{place}}", "json"),
    "energy": ("energy --samples 1e9 --force --json {place}", "json"),
}


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", OUTPUTS)
def test_a_place_that_cannot_be_written_is_refused_before_the_work(
    name: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("torchms.cli.energy.measure", refuse)
    line, suffix = OUTPUTS[name]
    folder = tmp_path / f"folder.{suffix}"
    folder.mkdir()
    where = PLACES[place].replace("{out}", str(folder)).replace("{suffix}", suffix)
    assert cli.main([part.replace("{place}", where) for part in line.split()]) == 2
    assert "torchms: error: " in capsys.readouterr().err
