"""Where light leaves Gaussian surfaces after one, two and three bounces: traced, in Smith's theory, and learned.

    python benchmarks/surface_lobes_figure.py [--out docs/figures/surface_lobes.png]

alpha = 1, light from the normal; mean over the azimuth. Of the light that benchmarks/surface_lobes.py keeps, traced if it is
not there.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import tyro
from matplotlib import pyplot as plt
from surface_lobes import CELLS, Options, light, lobes

from torchms import Distilled
from torchms.microsurface.distil.held_out import COLUMNS, ROWS

MATERIALS: dict[Literal["conductor", "diffuse"], str] = {"conductor": "metal, F = 1", "diffuse": "diffuse, albedo 1"}
SAID = ("one bounce", "two", "three")


@dataclass
class Figure:
    """Draw the lobes."""

    alpha: float = 1.0
    """Roughness."""
    theta: float = 0.0
    """Angle of incidence [rad]; one of those of the light."""
    table: tuple[Path, ...] = ()
    """Files of lobes in place of the packaged ones."""
    out: Path = Path("docs/figures/surface_lobes.png")


def main(options: Figure) -> None:
    cell = next(k for k, c in enumerate(CELLS) if c.ax == c.ay == options.alpha and c.theta == options.theta)
    z = (torch.arange(ROWS) + 0.5) / ROWS
    solid = 2 * math.pi / (ROWS * COLUMNS)
    figure, panels = plt.subplots(len(MATERIALS), len(SAID), figsize=(9, 5.4), sharex=True, layout="constrained")
    for row, (material, name) in zip(panels, MATERIALS.items(), strict=True):
        halves = light(Options(material=material))[:, cell]
        learned = Distilled(list(options.table)) if options.table else Distilled(surface="gaussian")
        models = {"Smith": lobes(material, Distilled())[cell], "learned": lobes(material, learned)[cell]}
        for k, (panel, said) in enumerate(zip(row, SAID, strict=True)):
            one, other = halves[:, k].mean(-1) / solid
            traced, spread = (one + other) / 2, (one - other).abs() / 2
            angle = torch.rad2deg(torch.acos(z))
            panel.errorbar(angle, traced, spread, fmt=".", color="k", ms=4, label="traced")
            for color, (model, lobe) in zip(("C1", "C0"), models.items(), strict=True):
                panel.plot(angle, lobe[k].mean(-1) / solid, color=color, label=model)
            panel.set_title(f"{name}: {said}", fontsize=9)
            panel.set_ylim(bottom=0)
        row[0].set_ylabel("f cos θ$_o$ [1/sr]")
    for panel in panels[-1]:
        panel.set_xlabel("θ$_o$ [°]")
    panels[0][0].legend(fontsize=8)
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main(tyro.cli(Figure))
