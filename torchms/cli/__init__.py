"""The command line: `torchms` or `python -m torchms`. Names are loaded when they are first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchms.cli.commands import COMMANDS, main
    from torchms.cli.expression import parse_bsdf
    from torchms.cli.options import RenderOptions
    from torchms.cli.render import run_render

_HOME = {
    "COMMANDS": "torchms.cli.commands",
    "RenderOptions": "torchms.cli.options",
    "main": "torchms.cli.commands",
    "parse_bsdf": "torchms.cli.expression",
    "run_render": "torchms.cli.render",
}

__all__ = ["COMMANDS", "RenderOptions", "main", "parse_bsdf", "run_render"]


def __getattr__(name: str) -> Any:
    # Lazy, because library code imports `torchms.cli.progress` from here, and `--help` must not wait for torch.
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'torchms.cli' has no attribute {name!r}")
