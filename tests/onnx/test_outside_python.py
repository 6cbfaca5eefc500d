"""An exported file in a runtime that is not Python's: onnxruntime's package for Node.

npm ci --ignore-scripts --prefix tests/onnx/node
"""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from exported_files import FILES, graph_of

from torchms import Stream
from torchms.onnx.parity.grid import grid

NODE = Path(__file__).parent / "node"


def run(path: Path, feeds: dict[str, torch.Tensor], tmp_path: Path) -> dict[str, torch.Tensor]:
    """The outputs of the file at `path`, from Node."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    if not (NODE / "node_modules" / "onnxruntime-node").is_dir():
        pytest.skip("onnxruntime-node is not installed: npm ci --ignore-scripts --prefix tests/onnx/node")
    written = {}
    for name, value in feeds.items():
        flat = value.flatten().tolist()
        data = [str(x) for x in flat] if value.dtype == torch.int64 else flat
        written[name] = {"type": str(value.dtype).removeprefix("torch."), "dims": list(value.shape), "data": data}
    (tmp_path / "feeds.json").write_text(json.dumps(written))
    command = [node, str(NODE / "run.mjs"), str(path), str(tmp_path / "feeds.json")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if result.returncode and "Cannot find" in result.stderr:
        pytest.skip(f"onnxruntime-node has no binary for this machine: {result.stderr.splitlines()[0]}")
    assert result.returncode == 0, result.stderr
    outputs = json.loads(result.stdout)["outputs"]
    return {name: torch.tensor(each["data"]).reshape(each["dims"]) for name, each in outputs.items()}


def test_single_bounce(exported_file: Callable[[str], Path], tmp_path: Path) -> None:
    from torchms.onnx.parity.eager import eagerly

    graph = graph_of("conductor-3")
    inputs = grid(graph, 2_000)
    value = run(exported_file("conductor-3"), inputs, tmp_path)["value"]
    eager = eagerly(graph, inputs)
    assert float(((value - eager).abs() / eager.abs().clamp_min(1e-9)).max()) < 5e-6


def test_seed(exported_file: Callable[[str], Path], tmp_path: Path) -> None:
    """64-bit seeds, negative ones among them, give the same random numbers there."""
    bsdf = FILES["conductor-seed"][0]()
    inputs = grid(graph_of("conductor-seed"), 2_000)
    inputs |= {"alpha": torch.full((2_000,), 0.3), "alpha_y": torch.full((2_000,), 0.3)}
    value = run(exported_file("conductor-seed"), inputs, tmp_path)["value"]
    eager = bsdf(inputs["wi"], inputs["wo"], Stream(inputs["seed"], 3))
    relative = (value - eager).abs() / eager.abs().clamp_min(1e-9)
    assert float(relative.quantile(0.999)) < 1e-5 and float(relative.max()) < 1e-3
