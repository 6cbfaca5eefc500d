"""Shapes in a file: those that its readers cannot infer."""

from typing import Any


def keep_needed(model: Any) -> None:
    """Drop the shapes of values between inputs and outputs, but for those from which all others follow.

    All shapes are two fifths of a file. Readers infer them, but not what an `Expand` to a computed shape gives, nor what
    follows from it; ONNX Runtime then plans its memory by comparing every value with all others.
    """
    from onnx.shape_inference import infer_shapes

    known = {value.name: value for value in model.graph.value_info}
    kept: dict[str, Any] = {}
    while True:
        del model.graph.value_info[:]
        model.graph.value_info.extend(kept.values())
        unknown = {value.name for value in infer_shapes(model).graph.value_info if not _is_known(value)}
        # Where they begin: all that such a node reads is known.
        first = {
            name
            for node in model.graph.node
            if not unknown.intersection(node.input)
            for name in unknown.intersection(node.output)
        }
        found = sorted((first & known.keys()) - kept.keys())
        if not found:
            return
        kept |= {name: known[name] for name in found}


def _is_known(value: Any) -> bool:
    """Whether every axis has a length, or the name of one of the file's free axes."""
    tensor = value.type.tensor_type
    if not tensor.HasField("shape"):
        return False
    names = [axis.dim_param for axis in tensor.shape.dim if not axis.HasField("dim_value")]
    return all(name and not name.startswith("unk__") for name in names)
