"""Sphinx: pages in Markdown, the API from the docstrings, the gallery from `examples/`; `make docs`."""

import re
import shutil
import sys
from pathlib import Path
from typing import Any

from sphinx.pycode import ModuleAnalyzer

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from torchms.version import __version__  # noqa: E402

project = "torchms"
author = "torchms developers"
copyright = "the torchms developers"
version = release = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.ifconfig",
    "sphinx.ext.viewcode",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["figures", "images", "gallery/*.py", "gallery/*.ipynb", "gallery/*.json"]
suppress_warnings = ["config.cache"]  # the gallery's settings change with the machine

html_theme = "furo"
html_title = f"torchms {version}"
html_show_sourcelink = False

# Examples run at a small size, those of `gallery_scripts.SMALL`; the others are shown as they are.
sphinx_gallery_conf = {
    "examples_dirs": ["../examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/(gbuffer_fit|learned_material|lobes|relight)\.py$",
    "ignore_pattern": r"(^|/)gbuffer\.py$",
    "within_subsection_order": "FileNameSortKey",
    "reset_argv": "gallery_scripts.small",
    "image_scrapers": ("matplotlib", "gallery_scripts.written"),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "write_computation_times": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
}

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
# Docstrings are plain prose, with `code` in single backticks.
default_role = "code"
CODE = re.compile(r"(`[^`]*`)")

LAB = HERE.parent / "build" / "lab"


def own_words(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Of a constant that a package passes on: what stands below it where it was made, not what its class says of itself."""
    package, _, leaf = name.rpartition(".")
    if what != "data" or lines[:1] != (type(obj).__doc__ or "").splitlines()[:1]:
        return
    for home in [
        path for path, module in sys.modules.items() if path.startswith(f"{package}.") and hasattr(module, leaf)
    ]:
        lines[:] = ModuleAnalyzer.for_module(home).find_attr_docs().get(("", leaf), lines)


def escape(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Outside of code, *, | and a trailing _ are themselves; lines indented by four are examples."""
    for i, line in enumerate(lines):
        if not line.startswith("    "):
            parts = CODE.split(line)
            parts[::2] = [re.sub(r"([*|\\]|_\b)", r"\\\1", part) for part in parts[::2]]
            lines[i] = "".join(parts)


def copy_lab(app: Any, error: Exception | None) -> None:
    """The lobe lab, where `make lab` has built it, becomes the folder `lab` of the site."""
    if error is None and app.builder.format == "html" and LAB.is_dir():
        shutil.copytree(LAB, Path(app.outdir) / "lab", dirs_exist_ok=True)


def setup(app: Any) -> None:
    app.add_config_value("lab_is_built", LAB.is_dir(), "env")
    app.connect("autodoc-process-docstring", own_words, priority=400)
    app.connect("autodoc-process-docstring", escape)
    app.connect("build-finished", copy_lab)
