"""How near are `Distilled(surface="gaussian")` and Smith's lobes to light on Gaussian surfaces of glass?

    python benchmarks/gaussian_glass.py [--eta 1.5] [--pairs 4] [--rays 32768] [--table FILE]

Alpha 0.25, 0.5, 1 and (1, 0.1), at 0, 0.5, 1 and 1.4 rad, from outside and from inside, reflected and transmitted, on
surfaces that nothing was learned from: the energies of the orders 1, 2, 3 and >= 4, also those of Smith's theory by exact
walks, the largest miss of R + T = 1, and the RMS error of each lobe over its RMS, in 32 x 64 cells of cos theta and phi.
"""

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from glass_surface_lobes import FIRST_KEY, missed, rms
from surface_lobes import ALPHAS, CELLS, surface

from torchms import Beckmann, Distilled, HeightWalk, RoughDielectric, Stream
from torchms.estimators.base import Scattering
from torchms.fresnel import Dielectric
from torchms.microsurface import DielectricFacets
from torchms.microsurface.distil import glass_report, held_out
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

WALKS = 1 << 16


@dataclass
class Options:
    """Compare lobes with ray-traced light."""

    eta: float = 1.5
    """Relative index of the inside."""
    pairs: int = 4
    """Pairs of surfaces of a million texels."""
    rays: int = 32768
    """Light paths of each surface, roughness and angle, from each side."""
    table: Path | None = None
    """A file of lobes of your own in place of the packaged ones."""
    out: Path | None = None
    """Where the numbers go: benchmarks/results if not given."""
    force: bool = False
    """Overwrite them."""


def said(model: Scattering, eta: float) -> glass_report.Orders:
    """|f cos θ_o| of the orders, seen from the side that light comes from."""

    @torch.no_grad()
    def orders(cell: held_out.Cell, wo: torch.Tensor) -> torch.Tensor:
        glass = RoughDielectric(Beckmann(cell.ax, cell.ay), Dielectric(eta), model, "importance")
        return glass.orders(glass_report.incident(cell, wo), wo)[..., 0]

    return orders


def compared(options: Options) -> list[dict[str, Any]]:
    """Rows of the report; light from inside falls on other tiles, to the inverse index."""
    learned = Distilled(surface="gaussian") if options.table is None else Distilled(options.table)
    models, rows, count = {"Smith": Distilled(), "distilled": learned}, [], 2 * options.pairs
    for k, eta in enumerate((options.eta, 1 / options.eta)):
        light = held_out.shares(
            lambda number, k=k: surface(number + k * count),
            *(count, CELLS, options.rays, FIRST_KEY + k),
            facets=DielectricFacets(eta),
            sides=2,
        )
        orders = {name: said(model, eta) for name, model in models.items()}
        alphas = [(cell.ax, cell.ay) for cell in CELLS]
        found = glass_report.rows(CELLS, alphas, light, orders, eta, glass_report.FROM[k])
        rows += [row | {"theory": {"energy": walked(CELLS[n // 2], eta)[n % 2]}} for n, row in enumerate(found)]
    return rows


@functools.cache
def walked(cell: held_out.Cell, eta: float) -> tuple[list[float], ...]:
    """Energies of the orders 1, 2, 3 and >= 4 in Smith's theory, reflected and transmitted."""
    glass = RoughDielectric(Beckmann(cell.ax, cell.ay), Dielectric(eta), HeightWalk(held_out.LONGEST))
    legs = glass.albedo(torch.from_numpy(cell.wi).float(), Stream(1, WALKS))
    return tuple([*(e := leg[:, 0].tolist())[:3], sum(e[3:])] for leg in (legs.reflected, legs.transmitted))


def gaps(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the table of docs/surface_lobes.md says of one roughness."""
    names = "Smith", "distilled"
    lobe = {name: float(np.mean([row[name]["lobe_error"] for row in rows])) for name in names}
    return {
        "first and rest": {name: rms(rows, name, True) for name in names},
        "by order": {name: rms(rows, name, False) for name in ("theory", "distilled")},
        "noise": math.sqrt(np.mean([np.square(row["energy_noise"]) for row in rows])),
        "mean lobe error": lobe,
        "noise of lobes": float(np.mean([row["Smith"]["noise"] for row in rows])),
        "largest miss of R + T": {name: float(np.abs(missed(rows, name)).max()) for name in names},
    }


def main(options: Options) -> None:
    out = options.out or Path(__file__).parent / "results" / f"gaussian_glass_{options.eta:g}.json"
    check_writable(out, options.force)
    rows = compared(options)
    found = {f"{a[0]:g},{a[1]:g}": gaps([row for row in rows if (row["alpha_x"], row["alpha_y"]) == a]) for a in ALPHAS}
    command = f"python benchmarks/gaussian_glass.py --eta {options.eta:g} --pairs {options.pairs} --rays {options.rays}"
    write_json(out, {"command": command, "version": __version__, "gaps": found, "cells": rows}, options.force)
    for row in rows:
        lobe = [f"{100 * row[name]['lobe_error']:.1f}" for name in ("Smith", "distilled")]
        off = [round(a - b, 4) for a, b in zip(row["distilled"]["energy"], row["energy"], strict=True)]
        print(
            f"{row['alpha_x']:g},{row['alpha_y']:g} {row['theta']:g} {row['from']} {row['leaves']}: lobe {lobe} %, {off}"
        )
    for alpha, gap in found.items():
        print(alpha, gap)


if __name__ == "__main__":
    main(tyro.cli(Options))
