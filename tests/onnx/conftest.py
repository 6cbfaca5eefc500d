"""Exported files are made without the run-time checks of types: the exporter traces what they would wrap."""

import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import jaxtyping
import pytest

pytest.importorskip("onnxscript", reason="needs the onnx extra: pip install torchms[onnx]")
pytest.importorskip("onnxruntime", reason="needs the onnx extra: pip install torchms[onnx]")

from exported_files import FILES
from lab_page import build

from torchms.onnx.exporter import exported
from torchms.storage.write import write_whole


@pytest.fixture(autouse=True, scope="module")
def unchecked_types() -> Iterator[None]:
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def exported_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The path of one of `FILES`, written once for all workers."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    folder = folder / "exported"
    folder.mkdir(exist_ok=True)

    def write(name: str) -> Path:
        path = folder / f"{name}.onnx"
        with open(folder / f"{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                make, arguments = FILES[name]
                write_whole(path, exported(make(), **arguments), force=True)
        return path

    return write


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lobe lab, built."""
    return build(tmp_path_factory.mktemp("lab") / "built")
