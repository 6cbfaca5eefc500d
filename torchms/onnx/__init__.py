"""Evaluators as self-contained ONNX files, and a front to run them.

`export(bsdf, path, ...)` writes one file; `Evaluator(path)` runs it on numpy arrays or tensors through ONNX Runtime, in
blocks. Needs the `onnx` extra: `pip install "torchms[onnx]"`.
"""

from typing import TYPE_CHECKING

from torchms.lazy import lazily

if TYPE_CHECKING:
    from torchms.onnx.evaluator import Evaluator as Evaluator
    from torchms.onnx.exporter import export as export

_HOME = {
    "Evaluator": "evaluator",
    "export": "exporter",
}

__getattr__ = lazily(__name__, _HOME)
