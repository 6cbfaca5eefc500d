"""How near are Smith's lobes and learned ones to light on Gaussian surfaces that nothing was learned from?

    python benchmarks/surface_lobes.py [--material diffuse] [--pairs 8] [--rays 32768] [--light FILE] [--table FILE]

Metal with F = 1, or diffuse facets with albedo 1, alpha 0.25, 0.5, 1 and (1, 0.1), at 0, 0.5, 1 and 1.4 rad. For each: the
energies of the orders 1, 2, 3 and >= 4, and the RMS error of the whole lobe over its RMS, in 32 x 64 cells of cos theta and
phi; the light's own noise is taken out by comparing with two halves of the surfaces. Light is kept in a file after each pair
of surfaces, and gone on from.
"""

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro

from torchms import Beckmann, Distilled, RoughConductor, RoughDiffuse
from torchms.estimators.base import Scattering
from torchms.fresnel import Ideal
from torchms.microsurface import GridTracer, Heightfield
from torchms.microsurface.distil.held_out import Cell, integrated, shares, summary
from torchms.microsurface.distil.kinds import KINDS
from torchms.microsurface.rays.grid import Grid
from torchms.microsurface.rays.grid_walk import GridCaster
from torchms.storage.archives import read_arrays
from torchms.storage.write import check_writable, write_json, write_whole
from torchms.version import __version__

ALPHAS = ((0.25, 0.25), (0.5, 0.5), (1.0, 1.0), (1.0, 0.1))
THETAS = (0.0, 0.5, 1.0, 1.4)
CELLS = [Cell(ax, ay, theta, 0.0) for ax, ay in ALPHAS for theta in THETAS]
FIRST_SURFACE, FIRST_KEY = 777_000_000, 9000
"""Seeds that no distillation uses."""


@dataclass
class Options:
    """Compare lobes with ray-traced light."""

    material: Literal["conductor", "diffuse"] = "conductor"
    """What the facets are of."""
    pairs: int = 8
    """Pairs of surfaces of a million texels."""
    rays: int = 32768
    """Light paths of each surface, roughness and angle."""
    light: Path | None = None
    """Where the light is kept: build/surface_light_MATERIAL.npz if not given."""
    table: Path | None = None
    """A file of lobes of your own in place of the packaged ones."""
    out: Path | None = None
    """Where the numbers go: benchmarks/results if not given."""
    force: bool = False
    """Overwrite them."""


def surface(number: int) -> GridCaster:
    """A surface with alpha = 1."""
    return GridTracer().bind(Grid.of(Heightfield.gaussian(1.0, size=1024, seed=FIRST_SURFACE + number)))


def light(options: Options) -> torch.Tensor:
    """Shares of the light in each cell of the lobes, mean over all pairs."""
    path = options.light or Path(f"build/surface_light_{options.material}.npz")
    total, done = None, 0
    if path.exists():
        kept = read_arrays(path, 1 << 30)
        if int(kept["rays"]) != options.rays:
            raise ValueError(f"{path} holds light of {int(kept['rays'])} paths; name another file with --light.")
        total, done = torch.from_numpy(kept["total"]), min(int(kept["pairs"]), options.pairs)
        if done < int(kept["pairs"]):
            raise ValueError(f"{path} holds {int(kept['pairs'])} pairs; ask for as many or more with --pairs.")
    for pair in range(done, options.pairs):
        found = shares(
            lambda k, p=pair: surface(2 * p + k),
            2,
            CELLS,
            options.rays,
            FIRST_KEY + pair,
            facets=KINDS[options.material].facets,
        )
        total = found if total is None else total + found
        file = io.BytesIO()
        np.savez(file, total=total.numpy(), pairs=np.array(pair + 1), rays=np.array(options.rays))
        write_whole(path, file.getvalue(), force=True)
        print(f"pair {pair + 1} of {options.pairs}", flush=True)
    assert total is not None
    return total / options.pairs


def lobes(material: str, model: Scattering) -> torch.Tensor:
    """What a model says of each cell."""

    def orders(cell: Cell, wo: torch.Tensor) -> torch.Tensor:
        facets = Beckmann(cell.ax, cell.ay)
        surface = RoughDiffuse(facets, 1.0, model) if material == "diffuse" else RoughConductor(facets, Ideal(), model)
        return surface.orders(torch.from_numpy(cell.wi).float().expand_as(wo), wo)[..., 0]

    return integrated(orders, CELLS)


def main(options: Options) -> None:
    suffix = KINDS[options.material].suffix
    out = options.out or Path(__file__).parent / "results" / f"surface_lobes{suffix}.json"
    check_writable(out, options.force)
    learned = Distilled(surface="gaussian") if options.table is None else Distilled(options.table)
    models = {name: lobes(options.material, model) for name, model in (("Smith", Distilled()), ("distilled", learned))}
    rows = summary(CELLS, light(options), models)
    gaps = {}
    for alpha in ALPHAS:
        some = [r for r in rows if (r["alpha_x"], r["alpha_y"]) == alpha]
        gaps[f"{alpha[0]:g},{alpha[1]:g}"] = {
            name: math.sqrt(np.mean([(np.array(r[name]["energy"]) - r["energy"]) ** 2 for r in some]))
            for name in ("Smith", "distilled")
        } | {"noise": math.sqrt(np.mean([np.array(r["energy_noise"]) ** 2 for r in some]))}
    material = f"--material {options.material} " if suffix else ""
    command = f"python benchmarks/surface_lobes.py {material}--pairs {options.pairs} --rays {options.rays}"
    content = {"command": command, "version": __version__, "rms_energy_gap": gaps, "cells": rows}
    write_json(out, content, options.force)
    for name, gap in gaps.items():
        print(name, {k: round(v, 5) for k, v in gap.items()})
    for r in rows:
        errors = [f"{100 * r[name]['lobe_error']:.2f} %" for name in ("Smith", "distilled")]
        white = sum(r["distilled"]["energy"]) - 1
        off = [round(a - b, 4) for a, b in zip(r["distilled"]["energy"], r["energy"], strict=True)]
        print(f"{r['alpha_x']:g},{r['alpha_y']:g} {r['theta']:g}: lobe {errors}, energies {off}, furnace {white:+.4f}")


if __name__ == "__main__":
    main(tyro.cli(Options))
