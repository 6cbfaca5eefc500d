"""How far distilled diffuse facets are from the exact model where they were not trained: lobes and furnace, as a table.

python benchmarks/distilled_diffuse.py --distribution GGX [--file mine.npz] [--fixed --paths 8192 32768]
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import tyro
from torch import Tensor

import torchms as ms
from torchms.approximations.distil import scenes
from torchms.approximations.distil.held_out import ALPHAS, ANGLES, RANDOM, Errors, cells, compared
from torchms.approximations.distil.rows import KINDS, Rows
from torchms.sampling.uniforms import generator_for

ALBEDOS = (0.2, 0.8, 1.0)
FIXED = len(ALPHAS) * len(ANGLES)
"""Surfaces and angles that are not random."""
LONGEST = 20
"""Most bounces of a walk of the reference; those beyond follow from the last two."""
POLAR, TURNS = 64, 128
"""Outgoing directions of an energy."""


@dataclass
class Options:
    """Errors of distilled diffuse facets."""

    distribution: Literal["GGX", "Beckmann"] = "GGX"
    """Whose facets."""
    file: Path | None = None
    """The lobes; those of torchms if it is not given."""
    points: int = 64
    """Outgoing directions of a lobe."""
    paths: tuple[int, int] = (2048, 8192)
    """Walks of either reference, and of its one bounce."""
    fixed: bool = False
    """Without the random surfaces: for references of many walks."""
    seed: int = 77
    """Of the references."""


def model(kind: str, where: Rows, albedo: float, file: Path | None) -> ms.BSDF:
    """Distilled facets, one surface a row."""
    return ms.RoughDiffuse(
        KINDS[kind](where.ax, where.ay), albedo, ms.Distilled() if file is None else ms.Distilled(file)
    )


def reference(kind: str, where: Rows, wo: Tensor, paths: tuple[int, int], seed: int) -> Tensor:
    """f cos θ_o (n, LONGEST + 1) of every order at albedo 1, the last one that of all beyond."""
    facets = KINDS[kind](where.ax, where.ay)
    walks = ms.compile(ms.RoughDiffuse(facets, 1.0, ms.Unidirectional(ms.Invariance(), LONGEST)), verbose=False)
    one = ms.compile(ms.RoughDiffuse(facets, 1.0, ms.Bidirectional(ms.Invariance(), 1)), verbose=False)
    f = walks.orders(where.wi, wo, ms.Stream(2 * seed, paths[0]))[..., 0]
    f[:, 0] = one(where.wi, wo, ms.Stream(2 * seed + 1, paths[1]))[:, 0]
    fall = (f[:, -1] / f[:, -2].clamp_min(1e-12)).nan_to_num(0).clamp(0, 0.8)
    return torch.cat([f, (f[:, -1] * fall / (1 - fall))[:, None]], 1)


def lobe_errors(options: Options, where: Rows) -> list[Errors]:
    """Of each albedo."""
    count, points = len(where.ax), options.points
    many = Rows(*(x.repeat_interleave(points, 0) for x in where))
    wo = scenes.hemisphere(count * points, generator_for(options.seed))
    found = [reference(options.distribution, many, wo, options.paths, 2 * options.seed + half) for half in (0, 1)]
    k = torch.arange(1, LONGEST + 2)
    errors = []
    for albedo in ALBEDOS:
        mine = model(options.distribution, many, albedo, options.file)(many.wi, wo)[:, 0]
        a, b = ((f * albedo**k).sum(1).double().view(count, points) for f in found)
        errors.append(compared(mine.double().view(count, points), 0 * a, a, b, torch.ones_like(a)))
    return errors


def furnace(options: Options, where: Rows) -> Tensor:
    """Energy − 1 of each cell at albedo 1, by quadrature."""
    z, dz = scenes.gauss(POLAR)
    turns = 2 * math.pi / TURNS * (torch.arange(TURNS) + 0.5)
    wo = torch.stack(torch.broadcast_tensors(*_around(z, turns)), -1).reshape(-1, 3)
    weights = (dz * 2 * math.pi / TURNS)[:, None].expand(POLAR, TURNS).reshape(-1)
    energy = []
    for cell in range(len(where.ax)):
        one = Rows(*(x[cell : cell + 1].expand(len(wo), *x.shape[1:]) for x in where))
        energy.append((model(options.distribution, one, 1.0, options.file)(one.wi, wo)[:, 0] * weights).sum() - 1)
    return torch.stack(energy)


def _around(z: Tensor, turns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    r = (1 - z * z).sqrt()[:, None]
    return r * turns.cos(), r * turns.sin(), z[:, None]


def rows(where: Rows) -> list[tuple[str, slice]]:
    """Groups of cells: each fixed surface at four angles, then the random ones."""
    random = [(f"{RANDOM} random", slice(FIXED, None))] if len(where.ax) > FIXED else []
    return [
        *(
            (f"alpha {float(where.ax[k]):g}, {float(where.ay[k]):g}", slice(k, k + len(ANGLES)))
            for k in range(0, FIXED, len(ANGLES))
        ),
        *random,
        ("all", slice(None)),
    ]


@torch.no_grad()
def main(options: Options) -> None:
    """Print the median and the largest error of each group."""
    where = cells((0.03, 1.0), options.seed)
    if options.fixed:
        where = Rows(*(x[:FIXED] for x in where))
    errors, energy = lobe_errors(options, where), furnace(options, where).abs()
    print(
        f"| cells | {' | '.join(f'albedo {a:g}: median, largest' for a in ALBEDOS)} | noise | furnace: median, largest |"
    )
    print("|---" * (len(ALBEDOS) + 3) + "|")
    for name, some in rows(where):
        columns = [f"{float(e.lobe[some].median()):.4f}, {float(e.lobe[some].max()):.4f}" for e in errors]
        noise, off = errors[-1].noise[some], energy[some]
        columns += [f"{float(noise.median()):.4f}", f"{float(off.median()):.5f}, {float(off.max()):.5f}"]
        print(f"| {name} | {' | '.join(columns)} |")


if __name__ == "__main__":
    main(tyro.cli(Options))
