"""A float64 file is offered only where all of it is float64, and as good as that."""

from typing import Any

from torchms.onnx.graph import Graph
from torchms.onnx.metadata import on_one_line
from torchms.onnx.parity.compare import check


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
            f"{on_one_line(graph.bsdf.scattering)} ({graph.what}) has {len(single)} float32 values. Export bsdf.float()."
        )


def refuse_rounded(content: bytes, graph: Graph) -> None:
    """Raise ValueError if a float64 file does not give float64 numbers: a constant may have been rounded on its way."""
    parity = check(content, graph, rows=4096)
    if parity.failures:
        raise ValueError(
            f"a float64 file is offered only where it is as good as that; {type(graph.bsdf).__name__} with "
            f"{on_one_line(graph.bsdf.scattering)} ({graph.what}) is not: {'; '.join(parity.failures)}. Export bsdf.float()."
        )
