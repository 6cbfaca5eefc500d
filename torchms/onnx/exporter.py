"""`export`: one evaluator, one self-contained file."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import torch

from torchms.bsdfs.base import BSDF
from torchms.extras import missing
from torchms.onnx import seal
from torchms.onnx.double import refuse_rounded
from torchms.onnx.graph import UNIFORMS, WHATS, Graph, Slot, slots
from torchms.onnx.metadata import describe
from torchms.onnx.tracing import traced
from torchms.storage.write import check_writable, write_whole


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
    target = check_writable(path, force)
    write_whole(target, exported(bsdf, what=what, parameters=parameters, uniforms=uniforms, n_paths=n_paths), force)
    return target


def exported(
    bsdf: BSDF,
    *,
    what: str = "forward",
    parameters: Sequence[str] = (),
    uniforms: str = "input",
    n_paths: int | None = 1,
) -> bytes:
    """What `export` writes, as bytes."""
    try:
        import onnx

        import_module("onnxscript")  # torch.onnx needs it
    except ImportError as error:
        raise missing("torchms.onnx.export", error.name or "onnxscript", "onnx") from error
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
