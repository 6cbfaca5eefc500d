"""The picture of `audit.py`: energy that is returned, and what is found in pictures of gold."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = ("#c4572b", "#d9a23b", "#1f5fa8", "#6c9fd8", "#8a5aa3", "#222222")


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Furnace straight on and grazing, error of the roughness, error of F0, against the roughness."""
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 10})
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.5), dpi=100, layout="constrained")
    names = list(dict.fromkeys(row["formula"] for row in rows))
    for name, colour in zip(names, COLOURS, strict=True):
        mine = [row for row in rows if row["formula"] == name]
        r = [row["roughness"] for row in mine]
        style = {"color": colour, "marker": "o", "markersize": 3.5, "linewidth": 2 if name == "all bounces" else 1.2}
        for axis, key in zip(axes, ("furnace_1", "furnace_0.15"), strict=False):
            axis.errorbar(r, [x[key] for x in mine], [x[f"{key}_stderr"] for x in mine], label=name, **style)
        off = [x["found_roughness"] - x["roughness"] for x in mine]
        axes[2].errorbar(r, off, [x["found_roughness_stderr"] for x in mine], **style)
        green = [x["f0_green"] - x["f0_green_truth"] for x in mine]
        axes[3].errorbar(r, green, [x["f0_green_stderr"] for x in mine], **style)
    titles = (
        "light returned, N·V = 1",
        "light returned, N·V = 0.15",
        "gold: roughness found − true",
        "gold: F0 found − true, green",
    )
    for axis, title, right in zip(axes, titles, (1.0, 1.0, 0.0, 0.0), strict=True):
        axis.axhline(right, color="#999999", linewidth=0.8, zorder=0)
        axis.set_title(title)
        axis.set_xlabel("roughness r, α = r²")
        axis.spines[["top", "right"]].set_visible(False)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncol=6, frameon=False, fontsize=8.5)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)
