"""What is done to a graph beyond the exporter: shorter forms, operators that runtimes have, no machine's trace."""

from collections.abc import Callable
from typing import Any

import torch
from onnxscript import ir, opset20

op: Any = opset20
"""Here its functions take and give values of a graph; their types are those of eager ONNX."""


def _right_shift(self: Any, other: int) -> Any:
    """x >> n of the stream's words, which are masked to 32 bits: a logical shift, in 3 nodes instead of 8."""
    wide = op.Cast(self, to=ir.DataType.UINT64)
    shift = op.Constant(value=ir.tensor(other, dtype=ir.DataType.UINT64))
    return op.Cast(op.BitShift(wide, shift, direction="RIGHT"), to=ir.DataType.INT64)


def translations() -> dict[Callable[..., Any], Callable[..., Any]]:
    """The exporter's `custom_translation_table`."""
    return {
        torch.ops.aten.__rshift__.Scalar: _right_shift,
        torch.ops.aten.bitwise_right_shift.Tensor_Scalar: _right_shift,
    }


def clean(model: ir.Model) -> None:
    """In place: selections between truth values as logic, short names, no metadata of nodes and values."""
    graph = model.graph
    _logical_selections(graph)
    model.metadata_props.clear()
    graph.metadata_props.clear()
    graph.name, graph.doc_string, model.doc_string = "torchms", None, None
    kept = {value for value in (*graph.inputs, *graph.outputs)}
    for value in kept:
        value.metadata_props.clear()
        value.doc_string = None
    count = 0
    for value in list(graph.initializers.values()):
        if value not in kept:
            value.name = f"c{count}"
            count += 1
        value.metadata_props.clear()
    count = 0
    for index, node in enumerate(graph):
        node.name = f"n{index}"
        node.metadata_props.clear()
        node.doc_string = None
        for value in node.outputs:
            value.metadata_props.clear()
            if value not in kept:
                value.name = f"v{count}"
                count += 1


def _logical_selections(graph: ir.Graph) -> None:
    """ONNX Runtime has no Where on BOOL: c ? a : b is (c and a) or (not c and b)."""
    for node in list(graph):
        if node.op_type != "Where" or node.outputs[0].dtype != ir.DataType.BOOL:
            continue
        condition, a, b = node.inputs
        new = [
            ir.node("And", [condition, a]),
            ir.node("Not", [condition]),
        ]
        new.append(ir.node("And", [new[1].outputs[0], b]))
        new.append(ir.node("Or", [new[0].outputs[0], new[2].outputs[0]]))
        for each in new:
            each.outputs[0].dtype = ir.DataType.BOOL
            each.outputs[0].shape = node.outputs[0].shape if each is new[-1] else None
        ir.convenience.replace_nodes_and_values(graph, node, [node], new, node.outputs, new[-1].outputs)
