"""What an exported file holds, that it gives eager's numbers, and what the exporter refuses."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from cases import COMPENSATIONS, DISTRIBUTIONS, ONE_OF_EACH, SCATTERINGS, bsdf, each, transmits
from exported_files import FILES, graph_of

from torchms import GGX, HeightWalk, RoughConductor, RoughDielectric, SingleBounce, Stream
from torchms.fresnel import Conductor, Dielectric, Ideal
from torchms.onnx import Evaluator, export
from torchms.onnx.exporter import checked, exported
from torchms.onnx.parity.compare import check
from torchms.onnx.parity.grid import grid
from torchms.version import __version__

File = Callable[[str], Path]
SIMPLE = RoughConductor(GGX(0.3), Ideal(), SingleBounce())


@pytest.mark.parametrize("name", FILES)
def test_parity(name: str, exported_file: File) -> None:
    """Pole, horizon, below it, tiny and large alpha, within the bounds of the file's kind."""
    parity = check(exported_file(name).read_bytes(), graph_of(name), rows=30_000)
    assert not parity.failures, parity


@pytest.mark.parametrize("name", FILES)
def test_valid_and_without_a_trace_of_the_machine(name: str, exported_file: File) -> None:
    content = exported_file(name).read_bytes()
    onnx.checker.check_model(content, full_check=True)
    for trace in (b"/", b".py", b"stack_trace", b"namespace"):
        where = content.find(trace)
        assert where < 0 or b"local frame" in content or trace == b"/", content[max(0, where - 40) : where + 40]
    assert str(Path(__file__).parents[2]).encode() not in content
    assert str(Path.home()).encode() + b"/" not in content
    model = onnx.load_model_from_string(content)
    assert not any(node.metadata_props or node.doc_string for node in model.graph.node)
    assert len(content) < 150_000


@pytest.mark.parametrize("name", FILES)
def test_every_shape_follows_from_the_few_that_are_written(name: str, exported_file: File) -> None:
    """Or else a runtime takes its time to plan its memory."""
    model = onnx.load(exported_file(name))
    assert len(model.graph.value_info) <= len(model.graph.node) / 10
    free = {axis.dim_param for each in model.graph.input for axis in each.type.tensor_type.shape.dim} - {""}
    for value in onnx.shape_inference.infer_shapes(model).graph.value_info:
        assert value.type.tensor_type.HasField("shape"), value.name
        for axis in value.type.tensor_type.shape.dim:
            # A length, or an expression such as 2*batch.
            names = set(re.findall(r"[a-z_]\w*", axis.dim_param))
            assert axis.HasField("dim_value") or (names and names <= free), value


def test_metadata(exported_file: File) -> None:
    session = onnxruntime.InferenceSession(exported_file("conductor-seed"))
    said = session.get_modelmeta().custom_metadata_map
    assert said["torchms.version"] == __version__
    assert said["torchms.what"] == "forward"
    assert said["torchms.orders"] == "2"
    assert said["torchms.n_paths"] == "3"
    assert said["torchms.uniforms"] == "seed"
    assert "Correlated" in said["torchms.model"] and "GGX" in said["torchms.material"]
    assert "away from the surface" in said["torchms.conventions"] and "1/sr" in said["torchms.conventions"]
    assert "Wang" in said["torchms.citation"]
    inputs = json.loads(said["torchms.inputs"])
    assert [each["name"] for each in inputs] == ["wi", "wo", "seed", "alpha", "alpha_y"]
    assert (inputs[3]["low"], inputs[3]["high"]) == (1e-3, 2.0)
    assert [each.name for each in session.get_inputs()] == ["wi", "wo", "seed", "alpha", "alpha_y"]


@pytest.mark.parametrize("name", ["conductor-1", "conductor-seed", "glass-orders", "conductor-sample"])
def test_batch_sizes_through_one_session(name: str, exported_file: File) -> None:
    """1, 3, 65 537 and 0 rows, straight through the runtime: the shapes, and no value that depends on the batch."""
    graph = graph_of(name)
    session = onnxruntime.InferenceSession(exported_file(name))
    inputs = {k: v.numpy() for k, v in grid(graph, 65_537).items()}
    whole = session.run(None, inputs)
    for rows in (0, 1, 3):
        some = session.run(None, {k: v[:rows] for k, v in inputs.items()})
        for part, all_rows in zip(map(np.asarray, some), map(np.asarray, whole), strict=True):
            assert part.shape == (rows, *all_rows.shape[1:])
            np.testing.assert_allclose(part, all_rows[:rows], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["conductor-3", "conductor-seed", "diffuse-sobol", "glass-orders"])
def test_deterministic(name: str, exported_file: File) -> None:
    """Two sessions, one and two threads, other blocks, other places in the batch: the same bits."""
    inputs = grid(graph_of(name), 20_011)
    path = exported_file(name)
    first = Evaluator(path)(**inputs)
    for other in (Evaluator(path), Evaluator(path, threads=2), Evaluator(path, block=999), Evaluator(path, threads=2)):
        assert torch.equal(first, other(**inputs))
    order = torch.randperm(20_011, generator=torch.Generator().manual_seed(0))
    assert torch.equal(first[order], Evaluator(path)(**{k: v[order] for k, v in inputs.items()}))
    assert torch.equal(first[7:8], Evaluator(path)(**{k: v[7:8] for k, v in inputs.items()}))


def test_seed_is_the_stream(exported_file: File) -> None:
    """A file with a seed gives what `Stream` gives in eager, on the same bits of random numbers."""
    bsdf = FILES["conductor-seed"][0]()
    inputs = grid(graph_of("conductor-seed"), 5_000)
    stream = Stream(11, 3)
    value = Evaluator(exported_file("conductor-seed"))(
        inputs["wi"], inputs["wo"], stream.seeds((5_000,)), alpha=0.3, alpha_y=0.3
    )
    eager = bsdf(inputs["wi"], inputs["wo"], stream)
    assert float(((value - eager).abs() / (eager.abs() + 1e-6)).quantile(0.999)) < 1e-5


def test_a_file_is_the_same_when_written_again(tmp_path: Path) -> None:
    one, two = (export(SIMPLE, tmp_path / name, what="pdf").read_bytes() for name in ("a.onnx", "b.onnx"))
    assert one == two
    assert not list(tmp_path.glob(".*"))


def test_refusals(tmp_path: Path) -> None:
    """What does not fit is refused before the work, with the argument, the value and the remedy."""
    path = tmp_path / "x.onnx"
    for arguments, words in (
        ({"what": "albedo"}, ["what", "'albedo'", "forward"]),
        ({"uniforms": "philox"}, ["uniforms", "'philox'", "seed"]),
        ({"parameters": ("alfa",)}, ["'alfa'", "alpha"]),
        ({"parameters": ("alpha", "alpha")}, ["twice"]),
        ({"n_paths": None, "uniforms": "seed"}, ["n_paths", "seed"]),
        ({"n_paths": 0}, ["n_paths", "0", "[1, 65536]"]),
    ):
        with pytest.raises(ValueError) as caught:
            export(SIMPLE, path, **arguments)
        assert all(word in str(caught.value) for word in words), caught.value
    mapped = RoughConductor(GGX(torch.tensor([0.3, 0.4])), Ideal(), SingleBounce())
    with pytest.raises(ValueError, match=r"alpha has a value per element.*parameters=\('alpha'"):
        export(mapped, path)
    with pytest.raises(ValueError, match="float32 or float64"):
        export(RoughConductor(GGX(0.3), Conductor(0.2, 3.0), SingleBounce()).bfloat16(), path)
    with pytest.raises(TypeError, match="BSDF"):
        export(torch.nn.Linear(1, 1), path)
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten_or_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.onnx"
    path.write_bytes(b"mine")
    with pytest.raises(FileExistsError, match="force"):
        export(SIMPLE, path)
    with pytest.raises(FileNotFoundError, match="folder"):
        export(SIMPLE, tmp_path / "none" / "x.onnx")
    monkeypatch.setattr("torchms.onnx.exporter.traced", lambda graph: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export(SIMPLE, path, force=True)
    assert path.read_bytes() == b"mine" and len(list(tmp_path.iterdir())) == 1


def test_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "onnxscript", None)
    with pytest.raises(ImportError, match=r"torchms\[onnx\]"):
        export(SIMPLE, tmp_path / "x.onnx")


QUICK = [
    *(("conductor[conductor]", name) for name in ("invariance", "kulla-conty")),
    ("diffuse", "single"),
]
EVERY = [(m, s) for m in ONE_OF_EACH for s in (*SCATTERINGS, *COMPENSATIONS) if m != "diffuse" or s in SCATTERINGS]


@pytest.mark.parametrize(
    "material,scattering",
    [
        pytest.param(*pair, marks=[] if pair in QUICK else pytest.mark.slow, id="-".join(pair))
        for pair in EVERY
        if not (transmits(pair[0]) and pair[1].endswith("invariance"))
    ],
)
def test_parity_over_the_tables(material: str, scattering: str) -> None:
    """Every material with every scattering, two bounces.

    α is an input, but for Kulla–Conty: its lost energy has few digits in float32 for a tiny α, in eager as in the file.
    """
    inputs = () if scattering == "kulla-conty" else ("alpha",)
    surface = bsdf(material, scattering, alpha=(0.5,), max_order=2, dtype=torch.float32)
    content = exported(surface, parameters=inputs)
    # So many, because what is sensitive is counted: a handful of rows in as many.
    parity = check(content, checked(surface, "forward", inputs, "input", 1), rows=131_072)
    assert not parity.failures, parity


@pytest.mark.slow
@each("distribution", [name for name in DISTRIBUTIONS if name != "gtr"])
def test_parity_of_every_distribution(distribution: str) -> None:
    """Its parameters are constants of the file."""
    surface = bsdf("conductor[ideal]", "single", distribution, dtype=torch.float32)
    parity = check(exported(surface), checked(surface, "forward", (), "input", 1), rows=30_000)
    assert not parity.failures, parity


@pytest.mark.slow
def test_double_over_several_bounces() -> None:
    bsdf = RoughDielectric(GGX(0.4, 0.6), Dielectric(1.5), HeightWalk(2)).double()
    parity = check(exported(bsdf), checked(bsdf, "forward", (), "input", 1), rows=30_000)
    assert parity.rel_p999 < 1e-12 and parity.misses == 0, parity


def test_double_is_refused_where_it_is_not_double(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the exporter's help, Python's numbers would be rounded to float32."""
    monkeypatch.setattr("torchms.onnx.graph._ARITHMETIC", set())
    bsdf = RoughConductor(GGX(0.3), Conductor(0.2, 3.0), SingleBounce()).double()
    with pytest.raises(ValueError, match=r"float64.*Export bsdf\.float\(\)"):
        export(bsdf, tmp_path / "x.onnx", what="pdf")
