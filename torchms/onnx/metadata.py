"""What a file says about itself: conventions, inputs and outputs, the papers behind it."""

import json
from typing import Any

import torch

from torchms.citations import cite
from torchms.onnx.graph import Graph
from torchms.version import __version__

OPSET = 20

CONVENTIONS = (
    "Directions are unit vectors in the local frame, +z the macro-normal, pointing away from the surface; wi is where "
    "light is known to be, wo where it is asked for. A value is f(wi, wo) |cos theta_o| [1/sr], its last axis the "
    "channels; orders[:, k-1] is what left after exactly k bounces; value is their sum. A pdf is a density over solid "
    "angle [1/sr]. alpha is the roughness of the slopes; u holds independent numbers in [0, 1), paths then dimensions."
)


def describe(model: Any, graph: Graph) -> None:
    """Write the conventions and what the file holds into its metadata."""
    bsdf = graph.bsdf
    entries = {
        "torchms.version": __version__,
        "torchms.what": graph.what,
        "torchms.conventions": CONVENTIONS,
        "torchms.material": on_one_line(bsdf),
        "torchms.model": on_one_line(bsdf.scattering),
        "torchms.orders": str(bsdf.max_order),
        "torchms.channels": str(bsdf.n_channels),
        "torchms.uniforms": graph.uniforms,
        "torchms.n_paths": str(_paths(graph)),
        "torchms.n_uniforms": str(graph.n_uniforms if graph.draws else 0),
        "torchms.opset": str(OPSET),
        "torchms.inputs": json.dumps(_inputs(graph)),
        "torchms.outputs": json.dumps(_outputs(graph)),
        "torchms.citation": cite(bsdf),
    }
    del model.metadata_props[:]
    for key, value in entries.items():
        model.metadata_props.add(key=key, value=value)
    model.producer_name, model.producer_version = "torchms", __version__
    model_name = type(bsdf.scattering).__name__
    model.doc_string = f"{graph.what} of {type(bsdf).__name__}, {model_name}: see the metadata for the conventions."


def _paths(graph: Graph) -> int | str:
    """Paths of a row, or the name of their axis."""
    return "paths" if graph.n_paths is None else graph.n_paths


def _inputs(graph: Graph) -> list[dict[str, Any]]:
    """Name, dtype and shape of each input, and the range of those that are parameters."""
    dtype, channels = _dtype(graph), graph.bsdf.n_channels
    entries: list[dict[str, Any]] = []
    parameters = {slot.name: slot.record for slot in graph.slots}
    shapes = {
        "wi": ["batch", 3],
        "wo": ["batch", 3],
        "seed": ["batch"],
        "u": ["batch", _paths(graph), graph.n_uniforms],
    }
    for name in graph.input_names:
        entry: dict[str, Any] = {"name": name, "dtype": "int64" if name == "seed" else dtype}
        if (record := parameters.get(name)) is None:
            entry["shape"] = shapes[name]
        else:
            shape = ["batch", channels] if record.channels else ["batch"]
            entry |= {"shape": shape, "low": record.low, "high": record.high}
        entries.append(entry)
    return entries


def _outputs(graph: Graph) -> list[dict[str, Any]]:
    """Name, shape and dtype of each output."""
    shapes = {
        "value": ["batch", graph.bsdf.n_channels],
        "orders": ["batch", graph.bsdf.max_order, graph.bsdf.n_channels],
        "wo": ["batch", _paths(graph), 3],
        "pdf": ["batch", _paths(graph)] if graph.what == "sample" else ["batch"],
    }
    return [{"name": name, "shape": shapes[name], "dtype": _dtype(graph)} for name in graph.output_names]


def _dtype(graph: Graph) -> str:
    return str(graph.bsdf.dtype).removeprefix("torch.")


def on_one_line(module: torch.nn.Module) -> str:
    """A module's description on one line."""
    return " ".join(str(module).split())
