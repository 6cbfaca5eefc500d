"""All twelve figures of [Wang2022] Figs. 4-15, drawn anew: 3 materials × alpha 0.25, 0.5, 1 and (1, 0.1).

python benchmarks/microsurface_figures.py [--out figures] [--rays 4e6] [--walks 1e6] [--surfaces 16] [--force]
"""

from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import tyro

from torchms.cli.figures import run_figures
from torchms.cli.options import FiguresOptions
from torchms.cli.surface import Material

ALPHAS = ((0.25, None), (0.5, None), (1.0, None), (1.0, 0.1))


@dataclass
class Options:
    """Draw all figures."""

    out: Path = Path("figures")
    """Directory for them."""
    rays: float = 4e6
    """Simulated light paths an angle."""
    walks: float = 1e6
    """Random walks a model and angle."""
    surfaces: int = 16
    """Independent surfaces."""
    seed: int = 1
    """Seed of everything."""
    force: bool = False
    """Overwrite the figures that exist; otherwise those are kept and only the missing ones are drawn."""


def main(options: Options) -> None:
    for material in get_args(Material):
        for alpha, alpha_y in ALPHAS:
            figure = FiguresOptions(
                material=material,
                alpha=alpha,
                alpha_y=alpha_y,
                rays=options.rays,
                walks=options.walks,
                surfaces=options.surfaces,
                seed=options.seed,
                out=options.out,
                force=options.force,
            )
            try:
                run_figures(figure)
            except FileExistsError as error:
                print(f"kept: {error}")


if __name__ == "__main__":
    main(tyro.cli(Options))
