"""Evaluators as self-contained ONNX files, and a front to run them.

`export(bsdf, path, ...)` writes one file; `Evaluator(path)` runs it on numpy arrays or tensors through ONNX Runtime, in
blocks. Needs the `onnx` extra: `pip install torchms[onnx]`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchms.onnx.evaluator import Evaluator
    from torchms.onnx.exporter import export

_HOME = {"Evaluator": "torchms.onnx.evaluator", "export": "torchms.onnx.exporter"}

__all__ = ["Evaluator", "export"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'torchms.onnx' has no attribute {name!r}")
