"""python -m torchms.approximations.distil.glass: from a seed to the two files of the lobes of rough glass.

Light comes from above, from a medium of index 1; η is that of the other one, above or below 1. What is reflected and what
is transmitted have networks of their own, and are fitted in turns, as glass keeps the energy that the other one lacks.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor

from torchms.approximations.distil import glass_fit, glass_held_out, glass_rows, glass_targets
from torchms.approximations.distil.command import Common, run, told
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.distil.rows import OUTGOING
from torchms.approximations.distilled import packaged
from torchms.approximations.glass_lobes import GlassLobes
from torchms.cli.progress import progress_bar
from torchms.sampling.uniforms import generator_for

ROWS = 65536
"""Rows of a block of data on either side."""


FACETS = ("reflected", "transmitted")


@dataclass
class Options(Common):
    """Distil what rough glass does after its first bounce: data by walks from both ends, small networks, two files.

    A stopped run goes on where it was if it is called again.
    """

    outs: tuple[Path, Path] = (Path("distilled_reflected.npz"), Path("distilled_transmitted.npz"))
    """The files."""
    paths: tuple[int, int] = (12, 24)
    """Walks of each row: from both ends for up to six bounces, and from one for more."""
    blocks: int = 8
    """Blocks of data."""
    widths: tuple[int, ...] = (24, 20)
    """Units of the hidden layers of a pair of directions; cost and accuracy follow them."""
    each: tuple[int, ...] = (12,)
    """Units of the hidden layers of one direction."""
    rounds: tuple[int, ...] = (40, 24, 24)
    """Damped Newton steps of either side in turns."""
    rows: int = 32768
    """Rows that a step's matrix is made of; all of them tell its direction."""
    cells: int = 1024
    """Directions of incidence at which energies are balanced."""
    packaged: bool = False
    """Begin with the networks that come with torchms, in place of random ones; with as many units as theirs, or more."""
    later: ClassVar[tuple[str, ...]] = ("widths", "each", "rounds", "rows", "cells", "packaged")


@torch.no_grad()
def block(options: Options, number: int) -> dict[str, Tensor]:
    """Surfaces, wo on either side, shares in the lobe's square, and f |cos θ_o| [1/sr] of one bounce and of the rest."""
    seed = options.seed * 4096 + number
    generator, kind = generator_for(seed), options.distribution
    found = {}
    for side, up in (("up", True), ("down", False)):
        where = glass_rows.drawn(options.alpha, ROWS // OUTGOING, generator)
        wo, weights = glass_rows.lobes(kind, where, up, OUTGOING, generator)
        wo = wo.reshape(-1, 3).contiguous()
        f = glass_targets.estimated(kind, where.repeated(OUTGOING), wo, 2 * seed + up, options.paths)
        arrays = {**where._asdict(), "wo": wo, "weights": weights.reshape(-1), "f": torch.stack(f, 1)}
        found |= {f"{side}_{name}": x for name, x in arrays.items()}
    return found


def main(options: Options) -> None:
    """Run all of it."""
    data, folder = told(options, "glass", lambda number: block(options, number))
    sides = fits(options, data)
    # One folder for what the steps depend on: more rounds go on from those that are there.
    numbers = "-".join(str(x) for x in (*options.widths, "of", *options.each, "by", options.rows, options.cells))
    numbers += "-on" if options.packaged else ""
    rounds = folder / f"fit-{numbers}"
    rounds.mkdir(exist_ok=True)
    for number, steps in enumerate(options.rounds):
        for k, name in enumerate(FACETS):
            # What is reflected knows nothing of the other side before the latter was fitted.
            other = sides[1 - k] if number or k or options.packaged else None
            with progress_bar(f"{name}, round {number + 1}", steps) as advance:
                sides[k].refined(other, steps, options.rows, rounds / f"round-{number}-{name}.npz", advance)
    found = [fit.distillate(name, options.alpha) for name, fit in zip(FACETS, sides, strict=True)]
    errors = glass_held_out.summary(GlassLobes(*found), options.distribution, options.alpha, options.seed + 5)
    for each, fit, out in zip(found, sides, options.outs, strict=True):
        rows = len(fit.data.f)
        options.write(each.facet, out, each.layers, each.skip, rows, sum(options.paths), errors, folder, each.each)


def fits(options: Options, data: dict[str, Tensor]) -> list[glass_fit.Fit]:
    """What is reflected, and what is transmitted, before the first step."""
    kind, found = options.distribution, []
    for side, facet in zip(("up", "down"), FACETS, strict=True):
        begin = packaged(kind, facet) if options.packaged else None
        where = Surfaces(*(data[f"{side}_{name}"] for name in Surfaces._fields))
        wo, weights, f = (data[f"{side}_{name}"] for name in ("wo", "weights", "f"))
        found.append(glass_fit.Fit(kind, where, wo, weights, f, (options.widths, options.each), options.seed, begin))
    cells = glass_rows.drawn(options.alpha, options.cells, generator_for(options.seed + 1))
    glass_fit.balanced(found, kind, cells, options.seed + 2)
    return found


if __name__ == "__main__":
    run(main, Options)
