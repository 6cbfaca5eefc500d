"""How near are lobes learned on one rough surface of glass to light on others like it, and how near are Smith's?

    python benchmarks/glass_surface_lobes.py [--alpha 1 1] [--paths 3e6] [--steps 800] [--table FILE]

Learns from light on one Gaussian surface of glass, eta 1.5, as `torchms distil --material dielectric` does, and compares with
light on other Gaussian surfaces, at 0, 0.5, 1 and 1.4 rad from outside and from inside: the energies of the orders 1, 2, 3 and
>= 4, reflected and transmitted, and the RMS error of each lobe over its RMS, in 32 x 64 cells of cos theta and phi.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from torchms.approximations import distilled_file as files
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.glass_surface_lobes import GlassSurfaceLobes
from torchms.distributions import Tabulated
from torchms.microsurface import DielectricFacets, GridTracer, Heightfield
from torchms.microsurface.distil import glass_report, glass_scan, held_out, light
from torchms.microsurface.distil.scan import ANGLES, MODELS, Effort
from torchms.microsurface.rays.grid import Grid
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

FIRST_SURFACE, FIRST_KEY = 777_000_000, 9000
"""Seeds that no distillation uses."""
ETA = 1.5
COMPARED = (MODELS[0], MODELS[2])


@dataclass
class Options:
    """Learn from one surface of glass, and compare with light on others."""

    alpha: tuple[float, float] = (1.0, 1.0)
    """Roughness along x and y."""
    paths: float = 3e6
    """Light paths to learn from."""
    steps: int = 800
    """Adam's steps."""
    surfaces: int = 4
    """Surfaces to be compared with; an even number."""
    rays: int = 32768
    """Light paths of each of them, at each angle, from each side."""
    table: Path | None = None
    """Where the lobes are kept: build/glass_AX_AY.npz if not given."""
    out: Path | None = None
    """Where the numbers go: benchmarks/results if not given."""
    force: bool = False
    """Overwrite them."""


def gaussian(options: Options, number: int) -> Heightfield:
    """A surface."""
    return Heightfield.gaussian(*options.alpha, size=1024, seed=FIRST_SURFACE + number)


def learned(options: Options, path: Path) -> files.Distillate:
    """Lobes of the first surface."""
    if not path.exists():
        effort = Effort(
            -(-int(options.paths) // light.PATHS),
            options.steps,
            material="dielectric",
            eta=ETA,
            held_out=1024,
            threads=1,
        )
        about = {"alpha": list(options.alpha), "eta": ETA, "paths asked": options.paths}
        found = glass_scan.distilled(gaussian(options, 0), path.with_suffix(".work"), effort, about)
        assert found is not None
        files.write(path, found[0])
    return files.read(path, NETWORKS)


def compared(options: Options, made: files.Distillate) -> list[dict[str, Any]]:
    """Rows of the report, against the light of other surfaces."""
    assert made.slopes is not None
    slopes, lobes, rows = Tabulated(*made.slopes), GlassSurfaceLobes(made), []
    where = [held_out.Cell(1.0, 1.0, theta, 0.0) for theta in ANGLES]
    others = [gaussian(options, 1 + n) for n in range(options.surfaces)]
    for k, eta in enumerate((ETA, 1 / ETA)):
        casters = [GridTracer().bind(Grid.of(light.turned_over(x) if k else x)) for x in others]
        facets, key = DielectricFacets(eta), FIRST_KEY + k
        traced = held_out.shares(casters, options.surfaces, where, options.rays, key, facets=facets, sides=2)
        said = glass_scan.models(lobes, slopes, eta)
        rows += glass_report.rows(where, [options.alpha] * len(where), traced, said, eta, glass_report.FROM[k])
    return rows


def rms(rows: list[dict[str, Any]], name: str, together: bool) -> float:
    """RMS gap of the energies, by order or of one bounce and all others."""

    def parts(energy: list[float]) -> list[float]:
        return [energy[0], sum(energy[1:])] if together else energy

    off = [np.subtract(parts(row[name]["energy"]), parts(row["energy"])) for row in rows]
    return float(np.sqrt(np.mean(np.square(off))))


def missed(rows: list[dict[str, Any]], name: str) -> np.ndarray:
    """R + T − 1 of each direction."""
    total = np.array([sum(row[name]["energy"]) for row in rows])
    return total[::2] + total[1::2] - 1


def main(options: Options) -> None:
    name = "_".join(f"{a:g}" for a in options.alpha)
    out = options.out or Path(__file__).parent / "results" / f"glass_surface_lobes_{name}.json"
    check_writable(out, options.force)
    path = options.table or Path(f"build/glass_{name}.npz")
    rows = compared(options, learned(options, path))
    noise = math.sqrt(np.mean([np.square(row["energy_noise"]) for row in rows]))
    gaps = {
        model: {"first and rest": rms(rows, model, True), "by order": rms(rows, model, False)} for model in COMPARED
    }
    command = f"python benchmarks/glass_surface_lobes.py --alpha {options.alpha[0]:g} {options.alpha[1]:g}"
    command += f" --paths {options.paths:g} --steps {options.steps} --rays {options.rays}"
    content = {"command": command, "version": __version__, "rms_energy_gap": gaps, "noise": noise, "cells": rows}
    write_json(out, content, options.force)
    for row in rows:
        lobe = [f"{100 * row[model]['lobe_error']:.1f}" for model in COMPARED]
        off = [round(a - b, 4) for a, b in zip(row["distilled"]["energy"], row["energy"], strict=True)]
        print(
            f"{row['from']} {row['theta']:g} {row['leaves']}: lobe {lobe} %, noise {100 * row[MODELS[0]]['noise']:.1f}, {off}"
        )
    print({m: {k: round(v, 5) for k, v in gap.items()} for m, gap in gaps.items()}, f"noise {noise:.5f}")
    print("R + T - 1:", missed(rows, "distilled").round(4).tolist())


if __name__ == "__main__":
    main(tyro.cli(Options))
