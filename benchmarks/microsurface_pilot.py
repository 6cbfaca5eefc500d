"""The simulator against its pilot, and its two tracers against each other.

    python benchmarks/microsurface_pilot.py [--rays 2.4e6] [--surfaces 24] [--out FILE] [--force]

Pilot: Beckmann, F = 1, 1024² texels, 16 per correlation length, 24 surfaces, 3.6e6 rays an entry. Agreement: share of
the rays for which the two tracers name different facets (a miss counts as one), from above and after one bounce.
"""

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from torchms.maths.frame import direction
from torchms.microsurface import (
    DielectricFacets,
    EmbreeTracer,
    GaussianSurfaces,
    GridTracer,
    Heightfield,
    MirrorFacets,
    simulate,
)
from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.simulation.launch import launch
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

PILOT = {
    (0.5, 1.0): (0.873, 0.109, 0.0127, 0.0030),
    (1.0, 0.0): (0.467, 0.477, 0.053, 0.0027),
    (1.0, 1.0): (0.772, 0.198, 0.022, 0.0046),
    (1.0, 1.5): (0.976, 0.022, 0.0014, 0.0003),
}


@dataclass
class Options:
    """Reproduce the pilot's numbers and compare the tracers."""

    rays: float = 2.4e6
    """Light paths an entry."""
    surfaces: int = 24
    """Independent surfaces."""
    agreement_rays: int = 500_000
    """Rays an entry of the comparison of the tracers."""
    seed: int = 11
    """Seed of everything."""
    out: Path = Path(__file__).parent / "results" / "microsurface_pilot.json"
    """Where the numbers go."""
    force: bool = False
    """Overwrite them."""


def pilot(options: Options) -> list[dict[str, Any]]:
    """Orders 1 … 4 beside the pilot's."""
    rows = []
    for (alpha, theta), numbers in PILOT.items():
        tally = simulate(
            GaussianSurfaces(alpha, count=options.surfaces),
            MirrorFacets(),
            direction(theta).numpy(),
            n_rays=options.rays,
            seed=options.seed,
            tracer=GridTracer(),
            lobes=False,
        )
        rows.append(
            {
                "alpha": alpha,
                "theta": theta,
                "pilot": list(numbers),
                "reflected": tally.reflected[:4, 0].tolist(),
                "stderr": tally.reflected_stderr[:4, 0].tolist(),
                "lost": tally.info["lost"][0],
                "leak_rate": tally.info["leak_rate"],
                "segments": tally.info["segments"],
            }
        )
        print(rows[-1], flush=True)
    return rows


def agreement(options: Options) -> list[dict[str, Any]]:
    """Share of rays on whose facet the tracers differ."""
    rows, n, key = [], options.agreement_rays, np.array([options.seed, 1], dtype=np.uint32)
    for alpha in (0.25, 1.0):
        grid = Grid.of(Heightfield.gaussian(alpha, size=1024, seed=options.seed))
        walk, embree = GridTracer().bind(grid), EmbreeTracer().bind(grid)
        for theta in (0.0, 1.0, 1.5):
            for bounces, material in ((0, MirrorFacets()), (1, MirrorFacets()), (1, DielectricFacets(1.5))):
                p = Paths.empty(n, 1, False)
                p.n = n
                place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
                launch(0, n, key, direction(theta).numpy(), 1024, 1024, grid.launch_height, *place, n)
                if bounces:
                    walk.cast(p)
                    material.scatter(p, grid, 1, key, False)
                q = deepcopy(p)
                walk.cast(p)
                count = embree.cast(q)
                rows.append(
                    {
                        "alpha": alpha,
                        "theta": theta,
                        "bounces": bounces,
                        "material": material.describe()["material"],
                        "rays": n,
                        "other_facet": float((p.tri != q.tri).mean()),
                        "hit_or_miss": float(((p.tri < 0) != (q.tri < 0)).mean()),
                        "embree_leaked": count.leaked,
                        "embree_repeats": count.repeats,
                    }
                )
                print(rows[-1], flush=True)
    return rows


def main(options: Options) -> None:
    check_writable(options.out, options.force)
    content = {
        "command": f"python benchmarks/microsurface_pilot.py --rays {options.rays:g} --surfaces {options.surfaces} "
        f"--seed {options.seed}",
        "version": __version__,
        "agreement": agreement(options),
        "pilot": pilot(options),
    }
    write_json(options.out, content, options.force)


if __name__ == "__main__":
    main(tyro.cli(Options))
