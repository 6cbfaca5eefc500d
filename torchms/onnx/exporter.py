"""`export`: one evaluator, one self-contained file."""

import contextlib
import json
import logging
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import torch

from torchms.bsdfs.base import BSDF
from torchms.citations import cite
from torchms.onnx import seal
from torchms.onnx.graph import UNIFORMS, WHATS, Graph, Slot, slots
from torchms.storage.write import check_writable, write_whole
from torchms.version import __version__

OPSET = 20
EXTRA = "It belongs to the onnx extra: pip install torchms[onnx]."

CONVENTIONS = (
    "Directions are unit vectors in the local frame, +z the macro-normal, pointing away from the surface; wi is where "
    "light is known to be, wo where it is asked for. A value is f(wi, wo) |cos theta_o| [1/sr], its last axis the "
    "channels; orders[:, k-1] is what left after exactly k bounces; value is their sum. A pdf is a density over solid "
    "angle [1/sr]. alpha is the roughness of the slopes; u holds independent numbers in [0, 1), paths then dimensions."
)


def export(
    bsdf: BSDF,
    path: str | Path,
    *,
    what: str = "forward",
    parameters: Sequence[str] = (),
    uniforms: str = "input",
    n_paths: int | None = 1,
    force: bool = False,
) -> Path:
    """Write `what` of `bsdf` as one ONNX file at `path`, and return the path.

    what: "forward" (output `value`, (batch, C)), "orders" (`orders`, (batch, K, C)), "sample" (`wo`, (batch, N, 3), and
    `pdf`, (batch, N)) or "pdf" (`pdf`, (batch)). Inputs are `wi` and, but for "sample", `wo`, each (batch, 3), where
    random numbers are needed `u` or `seed`, and the `parameters`.
    parameters: names of those that become inputs, one value an element: (batch), or (batch, C) for k, f0, albedo and a
    conductor's eta. The others are baked in, and must then be the same for all elements.
    uniforms: "input": an input `u` (batch, N, D); "sobol": a scrambled Sobol set of N points that serves every element
    is baked in; "seed": an input `seed`, int64 (batch), expanded as `torchms.Stream(seed, n_paths)` does.
    n_paths: N. None leaves it open, for "input" only.
    The dtype is that of `bsdf`. float64 is written only if nothing in the file is float32, and after its numbers were
    compared with eager's on a few thousand rows.
    Raises ValueError for arguments out of range and for what cannot be exported, with the reason; FileExistsError if
    `path` exists and `force` is not set; ImportError if the onnx extra is missing.
    """
    content = exported(
        bsdf, what=what, parameters=parameters, uniforms=uniforms, n_paths=n_paths, target=check_writable(path, force)
    )
    write_whole(path, content, force)
    return Path(path)


def exported(
    bsdf: BSDF,
    *,
    what: str = "forward",
    parameters: Sequence[str] = (),
    uniforms: str = "input",
    n_paths: int | None = 1,
    target: Path | None = None,
) -> bytes:
    """What `export` writes, as bytes."""
    try:
        import onnx
        import onnxscript  # noqa: F401  (torch.onnx needs it)
    except ImportError as error:
        raise ImportError(f"torchms.onnx.export needs {error.name}. {EXTRA}") from error
    graph = checked(bsdf, what, parameters, uniforms, n_paths)
    model = traced(graph)
    describe(model, graph)
    content = model.SerializeToString(deterministic=True)
    try:
        onnx.checker.check_model(content, full_check=True)
    except onnx.checker.ValidationError as error:
        raise ValueError(f"the exporter wrote a graph that onnx.checker refuses: {error}") from error
    content = seal.sealed(content)
    if bsdf.dtype == torch.float64:
        refuse_rounded(content, graph)
    return content


def checked(bsdf: BSDF, what: str, parameters: Sequence[str], uniforms: str, n_paths: int | None) -> Graph:
    """The module to be exported, or the reason why it cannot be."""
    if not isinstance(bsdf, BSDF):
        raise TypeError(f"export(bsdf=...) must be a BSDF such as RoughConductor(...); got {type(bsdf).__name__}.")
    if what not in WHATS:
        raise ValueError(f"export(what=...) must be one of {', '.join(WHATS)}; got {what!r}.")
    if uniforms not in UNIFORMS:
        raise ValueError(f"export(uniforms=...) must be one of {', '.join(UNIFORMS)}; got {uniforms!r}.")
    if n_paths is None and uniforms != "input":
        raise ValueError(f"export(n_paths=None) leaves N to the input u; uniforms={uniforms!r} needs a number.")
    if n_paths is not None and (isinstance(n_paths, bool) or not isinstance(n_paths, int) or not 1 <= n_paths <= 65536):
        raise ValueError(f"export(n_paths=...) must be an int in [1, 65536] or None; got {n_paths!r}.")
    if bsdf.dtype not in (torch.float32, torch.float64):
        raise ValueError(f"export(bsdf=...) must be float32 or float64; got {bsdf.dtype}. Convert it: bsdf.float().")
    if isinstance(parameters, str):
        parameters = (parameters,)
    known = slots(bsdf)
    chosen: list[Slot] = []
    for name in parameters:
        slot = known.get(name) or next((s for s in known.values() if s.dotted == name), None)
        if slot is None:
            raise ValueError(
                f"export(parameters=...) names {name!r}, which this BSDF does not have; it has {', '.join(known)}."
            )
        if slot in chosen:
            raise ValueError(f"export(parameters=...) names {name!r} twice.")
        chosen.append(slot)
    for name, slot in known.items():
        if slot in chosen or slot.value is None:
            continue
        if slot.record.batch(slot.value).numel() != 1:
            raise ValueError(
                f"{name} has a value per element, shape {tuple(slot.value.shape)}, which cannot be baked into a file "
                f"for any batch. Make it an input: parameters=({name!r}, ...)."
            )
    return Graph(bsdf, what, chosen, uniforms, n_paths).eval()


def traced(graph: Graph) -> Any:
    """`graph` as an onnx.ModelProto without a trace of the machine it was made on."""
    from onnxscript import ir

    from torchms.onnx.passes import clean, translations

    with _quiet(), torch.no_grad():
        try:
            program = torch.onnx.export(
                graph,
                graph.example(),
                dynamo=True,
                input_names=graph.input_names,
                output_names=graph.output_names,
                dynamic_shapes=(graph.dynamic_shapes(),),
                opset_version=OPSET,
                custom_translation_table=translations(),
                verbose=False,
            )
        except torch.onnx.OnnxExporterError as error:
            raise ValueError(
                f"{type(graph.bsdf).__name__} with {_line(graph.bsdf.scattering)} cannot be exported ({graph.what}): "
                f"{_root(error)}"
            ) from error
    assert program is not None
    clean(program.model)
    if graph.bsdf.dtype == torch.float64:
        refuse_float32(program.model, graph)
    return ir.serde.serialize_model(program.model)


def refuse_float32(model: Any, graph: Graph) -> None:
    """Raise ValueError if a float64 graph computes anything in float32."""
    from onnxscript import ir

    single = [
        value.name
        for node in ir.traversal.RecursiveGraphIterator(model.graph)
        for value in node.outputs
        if value.dtype == ir.DataType.FLOAT
    ]
    single += [name for name, value in model.graph.initializers.items() if value.dtype == ir.DataType.FLOAT]
    if single:
        raise ValueError(
            f"a float64 file is offered only where all of it is float64; {type(graph.bsdf).__name__} with "
            f"{_line(graph.bsdf.scattering)} ({graph.what}) has {len(single)} float32 values. Export bsdf.float()."
        )


def refuse_rounded(content: bytes, graph: Graph) -> None:
    """Raise ValueError if a float64 file does not give float64 numbers: a constant may have been rounded on its way."""
    from torchms.onnx.check import check

    parity = check(content, graph, rows=4096)
    if parity.failures:
        raise ValueError(
            f"a float64 file is offered only where it is as good as that; {type(graph.bsdf).__name__} with "
            f"{_line(graph.bsdf.scattering)} ({graph.what}) is not: {'; '.join(parity.failures)}. Export bsdf.float()."
        )


def describe(model: Any, graph: Graph) -> None:
    """Write the conventions and what the file holds into its metadata."""
    bsdf, dtype = graph.bsdf, str(graph.bsdf.dtype).removeprefix("torch.")
    C, N = bsdf.n_channels, graph.n_paths if graph.n_paths is not None else "paths"
    shapes: dict[str, list[int | str]] = {"wi": ["batch", 3], "wo": ["batch", 3], "seed": ["batch"]}
    shapes["u"] = ["batch", N, graph.n_uniforms]
    inputs = []
    by_name = {slot.name: slot for slot in graph.slots}
    for name in graph.input_names:
        slot = by_name.get(name)
        entry: dict[str, Any] = {"name": name, "dtype": "int64" if name == "seed" else dtype}
        if slot is None:
            entry["shape"] = shapes[name]
        else:
            record = slot.record
            entry |= {"shape": ["batch", C] if record.channels else ["batch"], "low": record.low, "high": record.high}
        inputs.append(entry)
    outputs = {
        "forward": {"value": ["batch", C]},
        "orders": {"orders": ["batch", bsdf.max_order, C]},
        "sample": {"wo": ["batch", N, 3], "pdf": ["batch", N]},
        "pdf": {"pdf": ["batch"]},
    }[graph.what]
    entries = {
        "torchms.version": __version__,
        "torchms.what": graph.what,
        "torchms.conventions": CONVENTIONS,
        "torchms.material": _line(bsdf),
        "torchms.model": _line(bsdf.scattering),
        "torchms.orders": str(bsdf.max_order),
        "torchms.channels": str(C),
        "torchms.uniforms": graph.uniforms,
        "torchms.n_paths": str(N),
        "torchms.n_uniforms": str(graph.n_uniforms if graph.draws else 0),
        "torchms.opset": str(OPSET),
        "torchms.inputs": json.dumps(inputs),
        "torchms.outputs": json.dumps([{"name": k, "shape": s, "dtype": dtype} for k, s in outputs.items()]),
        "torchms.citation": cite(bsdf),
    }
    del model.metadata_props[:]
    for key, value in entries.items():
        model.metadata_props.add(key=key, value=value)
    model.producer_name, model.producer_version = "torchms", __version__
    model_name = type(bsdf.scattering).__name__
    model.doc_string = f"{graph.what} of {type(bsdf).__name__}, {model_name}: see the metadata for the conventions."


def _line(module: torch.nn.Module) -> str:
    """A module's description on one line."""
    return " ".join(str(module).split())


def _root(error: BaseException) -> str:
    """First line of what went wrong in the first place."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without the exporter's remarks about torchvision and about its own internals."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
