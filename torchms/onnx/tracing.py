"""From a module to an ONNX graph, by torch's exporter."""

import contextlib
import logging
import warnings
from collections.abc import Iterator
from typing import Any

import torch

from torchms.onnx.double import refuse_float32
from torchms.onnx.graph import Graph
from torchms.onnx.metadata import OPSET, on_one_line
from torchms.onnx.shapes import keep_needed


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
                f"{type(graph.bsdf).__name__} with {on_one_line(graph.bsdf.scattering)} cannot be exported ({graph.what}): "
                f"{_root(error)}"
            ) from error
    assert program is not None
    clean(program.model)
    if graph.bsdf.dtype == torch.float64:
        refuse_float32(program.model, graph)
    model = ir.serde.serialize_model(program.model)
    keep_needed(model)
    return model


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
