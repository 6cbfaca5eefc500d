"""Sphinx: the API pages are made from the docstrings; `make docs`."""

import re
from typing import Any

from torchms.version import __version__

project = "torchms"
author = "torchms developers"
copyright = "the torchms developers"
version = release = __version__

extensions = ["sphinx.ext.autodoc", "sphinx.ext.viewcode", "myst_parser"]
myst_enable_extensions = ["colon_fence"]
exclude_patterns = ["figures", "images"]

html_theme = "furo"
html_title = f"torchms {version}"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
# Docstrings are plain prose, with `code` in single backticks.
default_role = "code"
CODE = re.compile(r"(`[^`]*`)")


def escape(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Outside of code, *, | and a trailing _ are themselves; lines indented by four are examples."""
    for i, line in enumerate(lines):
        if not line.startswith("    "):
            parts = CODE.split(line)
            parts[::2] = [re.sub(r"([*|\\]|_\b)", r"\\\1", part) for part in parts[::2]]
            lines[i] = "".join(parts)


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", escape)
