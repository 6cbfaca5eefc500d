"""The command line: `torchms` or `python -m torchms`. Names are loaded when they are first used."""

from typing import TYPE_CHECKING

from torchms.lazy import lazily

if TYPE_CHECKING:
    from torchms.cli.commands import COMMANDS as COMMANDS
    from torchms.cli.commands import main as main
    from torchms.cli.expression import parse_bsdf as parse_bsdf
    from torchms.cli.options import RenderOptions as RenderOptions
    from torchms.cli.render import run_render as run_render

_HOME = {
    "COMMANDS": "commands",
    "RenderOptions": "options",
    "main": "commands",
    "parse_bsdf": "expression",
    "run_render": "render",
}

__getattr__ = lazily(__name__, _HOME)
