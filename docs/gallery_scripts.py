"""How the gallery runs the scripts of `examples/`: small, on one picture each, which it shows."""

import shutil
import tempfile
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

SMALL = {
    "gbuffer_fit": ["--size", "20", "--steps", "120"],
    "relight": ["--size", "96", "--samples", "8"],
    "learned_material": ["--size", "32", "--steps", "300", "--batch", "512"],
    "lobes": [],
}
"""Options with which a script ends within half a minute on one core."""

PICTURES = Path(tempfile.mkdtemp(prefix="torchms-gallery-"))


def small(gallery_conf: dict[str, Any], script_vars: dict[str, Any]) -> list[str]:
    """The arguments of a script: its small size, and a picture of its own name."""
    name = Path(script_vars["src_file"]).stem
    options = SMALL.get(name)
    return [] if options is None else [*options, "--out", str(PICTURES / f"{name}.png"), "--force"]


def written(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """What a script wrote, as a figure."""
    found = PICTURES / f"{Path(block_vars['src_file']).stem}.png"
    if not found.is_file():
        return ""
    target = next(block_vars["image_path_iterator"])
    shutil.move(found, target)
    return figure_rst([target], gallery_conf["src_dir"])
