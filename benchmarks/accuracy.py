"""Which model is nearest to the ground truth? Energies per order of explicit microsurfaces against the four models.

    python benchmarks/accuracy.py [--rays 4e5] [--surfaces 8] [--walks 2e5] [--out FILE] [--force]

Conductor with F = 1, dielectric with eta = 1.5 and diffuse with albedo 1, Beckmann alpha 0.25, 0.5, 1 and (1, 0.1), at
0, 0.5, 1 and 1.5 rad. The error of a model is the RMS of its difference to the simulation over angles, orders 1 … 10
and sides; the noise is the RMS of the simulation's own standard error, and no difference below it means anything.
Height walk and invariance are both exact for Smith's model, so their difference is the noise of the walks, and what
they have in common is the gap of Smith's model itself (the mesh adds less than 4e-4, see
tests/microsurface/test_simulation.py).
"""

import math
import platform
import time
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.table import Table

from torchms.bsdfs.named import MATERIALS
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.microsurface.simulation.comparison import MODELS, SIMULATION, Case, energies, gap
from torchms.storage.write import check_writable, write_json
from torchms.version import __version__

ALPHAS = ((0.25, 0.25), (0.5, 0.5), (1.0, 1.0), (1.0, 0.1))
THETAS = (0.0, 0.5, 1.0, 1.5)


@dataclass
class Options:
    """Compare the models with explicit microsurfaces."""

    rays: float = 4e5
    """Simulated light paths an angle."""
    surfaces: int = 8
    """Independent surfaces."""
    size: int = 1024
    """Texels along each edge of a surface."""
    walks: float = 2e5
    """Random walks a model and angle."""
    seed: int = 1
    """Seed of everything."""
    out: Path = Path(__file__).parent / "results" / "microsurface_accuracy.json"
    """Where the numbers go."""
    force: bool = False
    """Overwrite them."""


def rms(x: torch.Tensor) -> float:
    return math.sqrt(float((x**2).mean()))


def main(options: Options) -> None:
    check_writable(options.out, options.force)
    begin = time.time()
    content = {
        "command": f"python benchmarks/accuracy.py --rays {options.rays:g} --surfaces {options.surfaces} "
        f"--size {options.size} --walks {options.walks:g} --seed {options.seed}",
        "version": __version__,
        "torch": torch.__version__,
        "machine": platform.machine(),
    }
    rows = []
    for material in MATERIALS:
        for alpha in ALPHAS:
            rows.append(row(material, alpha, options))
            print(f"{material} {alpha}: {time.time() - begin:.0f} s", flush=True)
            # After every row: a run of many minutes that is stopped leaves what it has.
            write_json(options.out, content | {"rows": rows}, force=True)
    show(rows)


def row(material: str, alpha: tuple[float, float], options: Options) -> dict:
    """All angles of one material and roughness."""
    gaps: dict[str, list[torch.Tensor]] = {}
    noise, angles, signed = [], [], {}
    for theta in THETAS:
        case = Case(material, alpha, theta)
        truth = case.simulated(options.surfaces, options.size, options.rays, options.seed, GridTracer())
        noise.append(torch.stack([truth.reflected_stderr, truth.transmitted_stderr])[..., 0])
        angle = {"theta": theta, SIMULATION: energies(truth) | {"leak_rate": truth.info["leak_rate"]}}
        for model in case.models:
            tally = case.modelled(model, int(options.walks), options.seed, lobes=False)
            gaps.setdefault(model, []).append(gap(tally, truth))
            angle[model] = energies(tally)
        angles.append(angle)
    sides = 2 if material == "dielectric" else 1
    stacked = {model: torch.stack(values)[:, :sides] for model, values in gaps.items()}
    signed = {model: values.sum(1).mean(0).tolist() for model, values in stacked.items()}
    return {
        "material": material,
        "alpha": list(alpha),
        "rms": {model: rms(values) for model, values in stacked.items()},
        "noise": rms(torch.stack(noise)[:, :sides]),
        "mean_gap_per_order": signed,
        "angles": angles,
    }


def show(rows: list[dict]) -> None:
    table = Table(title="RMS difference to the explicit surface, in 1e-4 of the incident energy (nearest in bold)")
    for heading in ("material", "alpha", *MODELS, "noise"):
        table.add_column(heading, justify="right")
    for r in rows:
        best = min(r["rms"].values())
        cells = []
        for model in MODELS:
            value = r["rms"].get(model)
            cells.append(
                "-" if value is None else f"[bold]{1e4 * value:.1f}" if value == best else f"{1e4 * value:.1f}"
            )
        alpha = f"{r['alpha'][0]:g}" + ("" if r["alpha"][0] == r["alpha"][1] else f", {r['alpha'][1]:g}")
        table.add_row(r["material"], alpha, *cells, f"{1e4 * r['noise']:.1f}")
    Console(width=110).print(table)


if __name__ == "__main__":
    main(tyro.cli(Options))
