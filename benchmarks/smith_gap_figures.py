"""Figures of docs/what_smith_misses.md, from the numbers of `smith_gap.py`."""

import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

NAMES = ("one bounce", "two", "three", "four and more")
COLORS = ("#1b4965", "#ca6702", "#6a994e", "#9b2226")


def draw(numbers: Path, folder: Path) -> None:
    """Write the figures."""
    content = json.loads(numbers.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    for name, needs, figure in (
        ("smith_gap_angles", ("angles",), angles),
        ("smith_gap_valley", ("angles",), valley),
        ("smith_gap_causes", ("angles", "forgetful"), causes),
        ("smith_gap_surfaces", ("angles", "exponential", "texels"), surfaces),
    ):
        if all(part in content for part in needs):  # a run that was stopped has some of them
            drawn = figure(content)
            drawn.savefig(folder / f"{name}.png", dpi=110)
            plt.close(drawn)


def gap(row: dict[str, Any]) -> np.ndarray:
    """Surface less Smith (4)."""
    return np.array(row["energy"]) - np.array(row["smith"])


def angles(content: dict[str, Any]) -> Figure:
    """Gap by order, angle and roughness."""
    alphas = sorted({row["alpha"] for row in content["angles"]})
    figure, axes = plt.subplots(1, len(alphas), figsize=(11, 3.6), sharey=True, layout="constrained")
    for axis, alpha in zip(axes, alphas, strict=True):
        rows = [row for row in content["angles"] if row["alpha"] == alpha]
        theta = [row["theta"] for row in rows]
        for k, (name, color) in enumerate(zip(NAMES, COLORS, strict=True)):
            axis.errorbar(
                theta,
                [gap(r)[k] for r in rows],
                [r["stderr"][k] for r in rows],
                color=color,
                label=name,
                marker="o",
                ms=3,
            )
        axis.axhline(0, color="0.7", lw=0.8, zorder=0)
        axis.set(title=f"α = {alpha:g}", xlabel="θ of incidence [rad]")
    axes[0].set_ylabel("energy: surface − Smith")
    axes[0].legend(fontsize=8, loc="lower left")
    return figure


def causes(content: dict[str, Any]) -> Figure:
    """The gap, and what is left of it where light forgets which valley it is in."""
    rows = {(r["alpha"], r["theta"]): r for r in content["angles"]}
    free = [r for r in content["forgetful"] if r["alpha"] == 1.0]
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.2), layout="constrained")
    for k, (axis, name) in enumerate(zip(axes, NAMES, strict=True)):
        theta = [r["theta"] for r in free]
        for values, label, color in (
            ([gap(rows[1.0, t])[k] for t in theta], "the surface", "#1b4965"),
            ([gap(r)[k] for r in free], "it forgets its valley", "#ca6702"),
        ):
            axis.plot(theta, values, "o-", color=color, label=label)
        axis.axhline(0, color="0.7", lw=0.8, zorder=0)
        axis.set(title=name, xlabel="θ of incidence [rad]")
    axes[0].set_ylabel("energy: surface − Smith, α = 1")
    axes[0].legend(fontsize=8)
    return figure


def valley(content: dict[str, Any]) -> Figure:
    """How far the second facet is from the first, and how steep both are along the ray."""
    edges = np.array(content["distances"])
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    middle = (edges[1:] + edges[:-1]) / 2
    for alpha, color in ((0.5, "#6a994e"), (1.0, "#1b4965")):
        row = next(r for r in content["angles"] if r["alpha"] == alpha and r["theta"] == 1.0)
        count, first, second, _ = (np.array(x)[:-1] for x in row["seen"])
        some = count > 50
        axes[0].plot(
            middle, count / np.array(row["seen"][0]).sum() / np.diff(edges), color=color, label=f"α = {alpha:g}"
        )
        axes[1].plot(middle[some], (first / np.maximum(count, 1))[some], "--", color=color)
        axes[1].plot(middle[some], (second / np.maximum(count, 1))[some], color=color)
    axes[0].set(
        xlabel="distance [correlation lengths]", ylabel="second facets, density", title="where the second facet is"
    )
    axes[1].set(
        xlabel="distance [correlation lengths]",
        ylabel="mean slope along the ray",
        title="first (dashed) and second facet",
    )
    axes[0].legend(fontsize=8)
    return figure


def surfaces(content: dict[str, Any]) -> Figure:
    """Two correlation functions, and three numbers of texels."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.2), layout="constrained")
    kinds = [("Gaussian", [r for r in content["angles"] if r["alpha"] == 1.0], "#1b4965", "o-")]
    kinds.append(("exponential", [r for r in content["exponential"] if r["alpha"] == 1.0], "#9b2226", "s-"))
    for texels, style in ((8, "^:"), (32, "v:")):
        kinds.append(
            (f"Gaussian, {texels} texels", [r for r in content["texels"] if r["texels"] == texels], "0.5", style)
        )
    for k, (axis, name) in enumerate(zip(axes, NAMES, strict=True)):
        for label, rows, color, style in kinds:
            some = [r for r in rows if r["theta"] in (0.0, 0.5, 1.0, 1.4)]
            axis.plot([r["theta"] for r in some], [gap(r)[k] for r in some], style, color=color, label=label, ms=4)
        axis.axhline(0, color="0.7", lw=0.8, zorder=0)
        axis.set(title=name, xlabel="θ of incidence [rad]")
    axes[0].set_ylabel("energy: surface − Smith, α = 1")
    axes[0].legend(fontsize=7)
    return figure
