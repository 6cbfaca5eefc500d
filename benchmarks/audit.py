"""What do the formulas in wide use do to rough metal? Against all bounces of Smith's theory, which are the truth here.

Furnace: the share of the light that a surface with F0 = 1 returns, seen straight on and at N·V = 0.15; 1 is right.
Reciprocity: the difference that exchanging view and light makes to f, root mean square over random pairs, relative to f.
Recovery: pictures of gold spheres under eight lights, made by the bidirectional estimator with measured refractive indices;
each formula is fitted to them by roughness and F0. Standard errors are of independent pictures.

    python benchmarks/audit.py        # results/audit.json, docs/images/audit.png, the table
"""

import argparse
import math
from pathlib import Path
from typing import Any

import torch
from audit_formulas import FORMULAS, Formula, proposal
from audit_pictures import fitted, gold_f0, photographs, sphere
from record import save
from rich.console import Console
from rich.table import Table
from torch import Tensor

from torchms.cli.progress import progress_bar
from torchms.sampling.stream import Stream

FIGURE = Path(__file__).parents[1] / "docs" / "images" / "audit.png"
VIEWS = {"1": 1.0, "0.15": 0.15}
"""N·V of the furnace."""
Estimate = tuple[float, float]
"""A mean and its standard error."""


def estimate(values: list[float]) -> Estimate:
    x = torch.tensor(values, dtype=torch.float64)
    return float(x.mean()), float(x.std() / math.sqrt(len(x)))


@torch.no_grad()
def furnace(formula: Formula, r: float, cosine: float, points: int, batches: int = 8) -> Estimate:
    """∫ f cos θ dω for F0 = 1, by the samples of a surface of that roughness, `points` of them in each of the batches."""
    view = torch.tensor([[math.sqrt(1 - cosine * cosine), 0.0, cosine]], dtype=torch.float64)
    surface, found = proposal(r), []
    for seed in range(batches):
        light, pdf = surface.sample(view[0], Stream(seed, points, "sobol"))
        n = len(light)
        value = formula(view.expand(n, 3), light, torch.full((n, 1), r).double(), torch.ones(n, 1).double())[:, 0]
        found.append(float(torch.where(pdf > 0, value / pdf.clamp_min(1e-30), 0.0).mean()))
    return estimate(found)


@torch.no_grad()
def asymmetry(formula: Formula, r: float, pairs: int) -> float:
    """√⟨(f(v, l) − f(l, v))²⟩ / √⟨f²⟩ over pairs whose solid angles, times cosines, are uniform."""
    u = torch.quasirandom.SobolEngine(4, scramble=True, seed=1).draw(pairs, dtype=torch.float64)
    v, d = (hemisphere(u[:, k], u[:, k + 1]) for k in (0, 2))
    f0, roughness = torch.ones(pairs, 1).double(), torch.full((pairs, 1), r).double()
    there, back = formula(v, d, roughness, f0) / d[:, 2:], formula(d, v, roughness, f0) / v[:, 2:]
    return float((there - back).square().mean().sqrt() / there.square().mean().sqrt())


def hemisphere(u: Tensor, v: Tensor) -> Tensor:
    rho, phi = (0.99 * u).sqrt(), 2 * math.pi * v
    return torch.stack([rho * phi.cos(), rho * phi.sin(), (1 - rho * rho).sqrt()], -1)


def recoveries(options: argparse.Namespace, r: float) -> dict[str, list[dict[str, Any]]]:
    """By formula, the fits to each of the pictures of gold with roughness r."""
    rows = sphere(options.size)
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in FORMULAS}
    with progress_bar(f"gold, r = {r:g}", options.pictures * len(FORMULAS)) as advance:
        for picture in photographs(rows, r, options.pictures, options.paths):
            for name, formula in FORMULAS.items():
                found[name].append(fitted(formula, rows, picture))
                advance(1)
    return found


def row(
    name: str, formula: Formula, r: float, fits: list[dict[str, Any]], options: argparse.Namespace
) -> dict[str, Any]:
    truth = gold_f0().tolist()
    result: dict[str, Any] = {"formula": name, "roughness": r, "reciprocity": asymmetry(formula, r, options.pairs)}
    for label, cosine in VIEWS.items():
        result[f"furnace_{label}"], result[f"furnace_{label}_stderr"] = furnace(formula, r, cosine, options.points)
    result["found_roughness"], result["found_roughness_stderr"] = estimate([fit["roughness"] for fit in fits])
    for channel, colour in enumerate(("red", "green", "blue")):
        value, error = estimate([fit["f0"][channel] for fit in fits])
        result |= {f"f0_{colour}": value, f"f0_{colour}_stderr": error, f"f0_{colour}_truth": truth[channel]}
    result["residual"] = estimate([fit["residual"] for fit in fits])[0]
    return result


def report(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Formulas in use against all bounces")
    columns = (
        "r",
        "formula",
        "furnace 1",
        "furnace 0.15",
        "asymmetry",
        "r found",
        "F0 red",
        "green",
        "blue",
        "residual",
    )
    for column in columns:
        table.add_column(column, justify="right")
    for x in rows:
        cells = [
            f"{x['roughness']:g}",
            x["formula"],
            *(f"{x[f'furnace_{v}']:.3f}" for v in VIEWS),
            f"{x['reciprocity']:.3f}",
        ]
        cells.append(f"{x['found_roughness']:.4f} ± {x['found_roughness_stderr']:.4f}")
        cells += [f"{x[f'f0_{c}']:.4f} ± {x[f'f0_{c}_stderr']:.4f}" for c in ("red", "green", "blue")]
        table.add_row(*cells, f"{x['residual']:.4f}")
    Console(width=170).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--roughness", type=float, nargs="+", default=[0.3, 0.5, 0.7, 0.9])
    parser.add_argument("--points", type=int, default=1 << 13, help="directions of a furnace, eight times")
    parser.add_argument("--pairs", type=int, default=1 << 14, help="of directions, for reciprocity")
    parser.add_argument("--size", type=int, default=32, help="pixels across and down")
    parser.add_argument("--paths", type=int, default=128, help="paths a pixel and light")
    parser.add_argument("--pictures", type=int, default=4, help="independent ones")
    parser.add_argument("--quick", action="store_true", help="a coarse run of one roughness; nothing is written")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.quick:
        options.roughness, options.points, options.pairs = [0.7], 1024, 1024
        options.size, options.paths, options.pictures = 12, 16, 2
    rows = []
    for r in options.roughness:
        fits = recoveries(options, r)
        rows += [row(name, formula, r, fits[name], options) for name, formula in FORMULAS.items()]
    report(rows)
    if not options.quick:
        from audit_figure import draw

        save("audit", rows)
        draw(rows, FIGURE)


if __name__ == "__main__":
    main()
