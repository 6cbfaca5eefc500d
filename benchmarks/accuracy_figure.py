"""The picture of `accuracy_lobes.py`: how far the lobes of every model are from the exact ones, and what gold looks like."""

import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.lines import Line2D

IMAGE = Path(__file__).parents[1] / "docs" / "images" / "accuracy.png"
# Okabe-Ito colours; the marker says the same as the colour.
MARKS = {
    "single bounce": ("o", "#000000"),
    "Turquin": ("v", "#E69F00"),
    "Kulla-Conty": ("^", "#D55E00"),
    "uncorrelated": ("s", "#56B4E9"),
    "correlated": ("D", "#0072B2"),
    "Distilled": ("*", "#009E73"),
}
NOISE = "height walk"


def errors(content: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Error of every model, over the angles of incidence, by the name of the case."""
    cases: dict[str, list[dict[str, float]]] = {}
    for row in content["lobes"]:
        alpha = ", ".join(f"{a:g}" for a in row["alpha"])
        label = f"{row.get('material', 'metal')}, {row['distribution']} {alpha}"
        cases.setdefault(label, []).append(row["error"])
    return {
        label: {name: math.sqrt(sum(e[name] ** 2 for e in rows) / len(rows)) for name in rows[0]}
        for label, rows in cases.items()
    }


def draw(content: dict[str, Any], path: Path = IMAGE) -> None:
    """A line a case, a mark a model; what lies in the gray part cannot be told from the noise of the reference."""
    plt.rcParams.update({"font.size": 10})
    cases = errors(content)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10.5, 0.42 * len(cases) + 1.6), width_ratios=(1.8, 1), layout="constrained"
    )
    smallest = min(min(found.values()) for found in cases.values()) / 1.5
    for y, found in enumerate(cases.values()):
        left.fill_betweenx((y - 0.5, y + 0.5), smallest, found[NOISE], color="0.88", linewidth=0)
        for name, (mark, colour) in MARKS.items():
            if name in found:
                left.plot(found[name], y, mark, color=colour, markersize=10 if mark == "*" else 6)
    left.set_xscale("log")
    left.set_xlim(smallest, None)
    left.set_yticks(range(len(cases)), list(cases))
    left.set_ylim(len(cases) - 0.5, -0.5)
    left.set_xlabel("error of the lobe, RMS over RMS; gray: noise of the exact one")
    left.grid(axis="x", alpha=0.3)
    handles = [Line2D([], [], marker=m, color=c, linestyle="", label=name) for name, (m, c) in MARKS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(MARKS), frameon=False)
    _gold(right, content)
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    plt.close(figure)


def _gold(axis: Any, content: dict[str, Any]) -> None:
    row = next(r for r in content["metals"] if r["metal"] == "Au" and r["alpha"] == 1.0)
    names = [name for name in ("invariance", *reversed(MARKS)) if name in row["rgb"]]
    for c, (letter, colour) in enumerate({"R": "#b2182b", "G": "#1b7837", "B": "#2166ac"}.items()):
        for y, name in enumerate(names):
            at = y + (c - 1) * 0.27
            axis.barh(at, row["rgb"][name][c], 0.27, color=colour)
            axis.text(row["rgb"][name][c] + 0.01, at, letter, va="center", fontsize=7)
    axis.set_yticks(range(len(names)), ["exact" if name == "invariance" else name for name in names])
    axis.invert_yaxis()
    axis.set_xlabel("reflected energy of gold,\nGGX α = 1, 0.5 rad")
    axis.grid(axis="x", alpha=0.3)
