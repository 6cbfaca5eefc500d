"""The front to the runtime: what it takes, what it gives back, and what it says about the rest."""

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from hostile import damaged
from onnx import TensorProto, helper

from torchms.onnx import Evaluator, seal

File = Callable[[str], Path]


def directions(*shape: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(len(shape))
    return torch.nn.functional.normalize(torch.randn(*shape, 3, generator=generator), dim=-1).abs()


@pytest.fixture
def evaluator(exported_file: File) -> Evaluator:
    return Evaluator(exported_file("conductor-3"))


def test_broadcasting_and_kinds(evaluator: Evaluator) -> None:
    """Batches broadcast, parameters may be numbers or lists; tensors in, tensor out, arrays in, array out."""
    wi, wo = directions(4, 1), directions(5)
    value = evaluator(wi, wo, alpha=0.3, alpha_y=0.7, eta=[0.2, 0.25, 0.3], k=[[3.9, 3.8, 3.7]] * 5)
    assert isinstance(value, torch.Tensor) and value.shape == (4, 5, 3)
    array = evaluator(
        wi.numpy(), wo.numpy(), np.float32([0.3]), alpha_y=0.7, eta=np.float32([0.2, 0.25, 0.3]), k=[3.9, 3.8, 3.7]
    )
    assert isinstance(array, np.ndarray) and np.array_equal(array, value.numpy())
    one = evaluator(wi[2, 0], wo[3], alpha=0.3, alpha_y=0.7, eta=[0.2, 0.25, 0.3], k=[3.9, 3.8, 3.7])
    assert one.shape == (3,) and torch.equal(one, value[2, 3])
    assert evaluator(wi[:0, 0], wo[:0], alpha=0.3, alpha_y=0.7, eta=1.0, k=1.0).shape == (0, 3)


def test_two_outputs_have_names(exported_file: File) -> None:
    sample = Evaluator(exported_file("conductor-sample"))
    result = sample(directions(6), torch.rand(6, 2, 3), alpha=0.3)
    assert result.wo.shape == (6, 2, 3) and result.pdf.shape == (6, 2)


def test_open_number_of_paths(exported_file: File) -> None:
    glass = Evaluator(exported_file("glass-orders"))
    numbers = glass.inputs[2].tail[1]
    for n_paths in (1, 5):
        u = torch.rand(4, n_paths, int(numbers))
        assert glass(directions(4), directions(4), u, eta=1.5).shape == (4, 2, 1)


@pytest.mark.parametrize(
    "change,kind,words",
    [
        ({"k": None}, TypeError, ["missing", "k (batch, 3)"]),
        ({"albedo": 0.3}, TypeError, ["'albedo'", "wi, wo, alpha"]),
        ({"wi": directions(7).double()}, TypeError, ["wi", "float32", "float64"]),
        ({"wi": "up"}, TypeError, ["wi", "str"]),
        ({"wi": directions(7)[:, :2]}, ValueError, ["wi", "(*batch, 3)", "(7, 2)"]),
        ({"wi": directions(6)}, ValueError, ["broadcast", "wi (6,)", "wo (7,)"]),
        ({"k": torch.rand(7, 2)}, ValueError, ["k", "(*batch, 3)", "(7, 2)"]),
        ({"alpha": 0.0}, ValueError, ["alpha", "[0.001, 2]", "got 0"]),
        ({"alpha": torch.tensor([float("nan")] * 7)}, ValueError, ["alpha", "nan"]),
    ],
)
def test_arguments_that_do_not_fit(evaluator: Evaluator, change: dict, kind: type, words: list[str]) -> None:
    given = {"wi": directions(7), "wo": directions(7), "alpha": 0.3, "alpha_y": 0.7, "eta": 0.2, "k": 3.0} | change
    with pytest.raises(kind) as caught:
        evaluator(**{name: value for name, value in given.items() if value is not None})
    assert all(word in str(caught.value) for word in words), caught.value


def test_files_that_are_not_ours(tmp_path: Path, exported_file: File) -> None:
    good = exported_file("beckmann-pdf").read_bytes()

    def says(content: bytes, *words: str) -> None:
        path = tmp_path / "x.onnx"
        path.write_bytes(content)
        with pytest.raises(ValueError) as caught:
            Evaluator(path)
        assert all(word in str(caught.value) for word in ("x.onnx", *words)), caught.value

    with pytest.raises(FileNotFoundError, match="no file"):
        Evaluator(tmp_path / "none.onnx")
    says(b"", "not written by torchms")
    says(b"hello", "not written by torchms")
    node = helper.make_node("Relu", ["x"], ["y"])
    value = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [None]) for n in "xy"]
    foreign = helper.make_model(helper.make_graph([node], "g", value[:1], value[1:]))
    says(foreign.SerializeToString(), "not written by torchms")
    says(good[:-1], "damaged")
    says(good[: len(good) // 2], "damaged") if b"torchms.conventions" in good[: len(good) // 2] else None
    for where in range(0, len(good) - seal._LENGTH, len(good) // 17):
        says(good[:where] + bytes([good[where] ^ 1]) + good[where + 1 :], "damaged")
    body = good[: -seal._LENGTH]
    newer = seal.sealed(body).replace(b"001 ", b"002 ")
    says(newer, "format 2", "newer torchms")
    resaved = onnx.load_model_from_string(good)
    resaved.metadata_props.add(key="mine", value="1")
    says(resaved.SerializeToString(), "changed by another tool")
    path = tmp_path / "resaved.onnx"
    path.write_bytes(resaved.SerializeToString())
    assert Evaluator(path, verify=False).metadata["mine"] == "1"


def test_damaged_files(tmp_path: Path, exported_file: File, seed: int) -> None:
    """Cut anywhere, or with any bit changed: the seal tells, before the runtime sees it."""
    good = exported_file("beckmann-pdf").read_bytes()
    path = tmp_path / "x.onnx"
    for content in damaged(good, seed):
        path.write_bytes(content)
        if content == good:
            continue
        with pytest.raises(ValueError, match=r"x\.onnx (is damaged|was not written|is of format)"):
            Evaluator(path)


def test_forged_files_with_a_seal(tmp_path: Path, exported_file: File) -> None:
    """Anybody can put a seal on a file: what it then refers to, or says about itself, is refused all the same."""
    path, secret = tmp_path / "x.onnx", tmp_path / "secret.bin"
    secret.write_bytes(bytes(4))

    def says(words: str) -> None:
        with pytest.raises(ValueError, match=words):
            Evaluator(path)

    weight = TensorProto(name="w", dims=[1], data_type=TensorProto.FLOAT, data_location=TensorProto.EXTERNAL)
    weight.external_data.add(key="location", value=secret.name)
    value = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [None]) for n in "xy"]
    graph = helper.make_graph([helper.make_node("Add", ["x", "w"], ["y"])], "g", value[:1], value[1:], [weight])
    path.write_bytes(seal.sealed(helper.make_model(graph).SerializeToString()))
    says(r"x\.onnx refers to data in other files")
    for forged in ("[", "[]]", '{"a": 1}', "[1]", '[{"name": "x"}]', "[" * 100_000):
        model = onnx.load_model_from_string(exported_file("beckmann-pdf").read_bytes())
        kept = [entry for entry in model.metadata_props if entry.key != seal.KEY.decode()]
        texts = {entry.key: entry.value for entry in kept} | {"torchms.inputs": forged}
        del model.metadata_props[:]
        for key, text in texts.items():
            model.metadata_props.add(key=key, value=text)
        path.write_bytes(seal.sealed(model.SerializeToString()))
        says("what it says of its inputs and outputs cannot be read")
    os.truncate(path, (1 << 28) + 1)
    says(r"is of 268435457 bytes; at most 268435456 are read")


@pytest.mark.parametrize("argument,value", [("threads", 0), ("threads", 1.5), ("block", 0)])
def test_options_that_do_not_fit(argument: str, value: float, exported_file: File) -> None:
    with pytest.raises(ValueError, match=argument):
        Evaluator(exported_file("beckmann-pdf"), **{argument: value})


def test_without_torch(exported_file: File) -> None:
    """Arrays need no torch."""
    code = (
        "import sys, numpy as np; from torchms.onnx import Evaluator; "
        f"e = Evaluator({str(exported_file('beckmann-pdf'))!r}); "
        "w = np.float32([[0.0, 0.6, 0.8]]); print(e(w, w, alpha=0.3)[0]); assert 'torch' not in sys.modules"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_memory_is_bounded(exported_file: File) -> None:
    """4 million rows: no more than 300 MB above inputs and outputs."""
    evaluator = Evaluator(exported_file("conductor-1"), threads=2)
    rows = 4_000_000
    wi = np.tile(directions(1000).numpy(), (rows // 1000, 1))
    evaluator(wi[:1000], wi[:1000], alpha=0.3, alpha_y=0.3)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    value = evaluator(wi, wi, alpha=0.3, alpha_y=0.3)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert value.shape == (rows, 1)
    assert (after - before) * 1024 < value.nbytes + 300e6, f"{(after - before) / 1024:.0f} MB"
