"""python -m torchms.approximations.distil: from a seed to a file of lobes for `Distilled`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations.distil import blocks, energies, facets, held_out, refinement, training
from torchms.approximations.distil.command import (
    PLACES,
    check_alpha,
    check_layers,
    check_least,
    check_seed,
    command_of,
    commit,
    run,
)
from torchms.approximations.distil.processes import processes, wait_for_all
from torchms.approximations.distil.rows import Rows, surfaces
from torchms.approximations.distil.weights import Heads, Net, Weights, sizes_of
from torchms.approximations.distilled_networks import METAL
from torchms.approximations.metal_lobes import MetalLobes
from torchms.approximations.network import Network
from torchms.cli.progress import progress_bar
from torchms.sampling.uniforms import generator_for
from torchms.storage.write import check_writable
from torchms.version import __version__


@dataclass
class Options:
    """Distil the bounces of rough metal: data by the exact estimators, a small network, held-out errors, a file.

    A stopped run goes on where it was if it is called again. Under torchrun the data are made by all processes.
    """

    distribution: Literal["GGX", "Beckmann"] = "GGX"
    """Whose facets."""
    alpha: tuple[float, float] = (0.03, 1.0)
    """Smallest and largest roughness."""
    out: Path = Path("distilled.npz")
    """The file."""
    work: Path = Path("build/distil")
    """Folder of blocks of data and of checkpoints, one a set of options."""
    blocks: int = 22
    """Blocks of 65 536 pairs of directions."""
    paths: tuple[int, int] = (48, 144)
    """Bidirectional paths of each for two and three bounces, and walks for more."""
    start: Path | None = None
    """A file of lobes to begin with, in place of chance and Adam's steps; its layers take the place of the widths."""
    steps: int = 1000
    """Steps of Adam."""
    refinements: int = 160
    """Levenberg-Marquardt steps after them."""
    cells: int = 2048
    """Directions of incidence at which energies are balanced."""
    widths: tuple[int, ...] = (16, 12)
    """Units of the hidden layers; cost and accuracy follow them."""
    each: tuple[int, ...] = (8,)
    """Units of the hidden layers of the network of each direction."""
    facets: int = 12
    """Units of the hidden layer of the network of the facets."""
    facet_steps: int = 250
    """Steps of L-BFGS of that network."""
    seed: int = 1
    """Seed of everything."""
    held_out_points: int = 128
    """Outgoing directions at which each held-out lobe is compared."""
    held_out_paths: tuple[int, int] = (128, 256)
    """Paths of either reference there."""
    force: bool = False
    """Overwrite the file."""


def main(options: Options) -> None:
    """Run all of it. Raises ValueError for options that do not fit, FileExistsError for a file that is there."""
    check(options)
    rank, world = processes()
    check_writable(options.out, options.force)
    told = {k: v for k, v in asdict(options).items() if k not in PLACES}
    if options.start:
        told["start"] = options.start.name
    folder = options.work / options.distribution
    later = ("refinements", "facets", "facet_steps", "held_out_points", "held_out_paths")
    begun = {name: value for name, value in told.items() if name not in later}
    blocks.opened(folder, {"version": __version__, "format": files.FORMAT, **begun})
    numbers = list(range(rank, options.blocks, world))
    with progress_bar("blocks of data", len(numbers)) as advance:
        blocks.made(folder, options.distribution, options.alpha, options.seed, options.paths, numbers, advance)
    wait_for_all(world)
    if rank == 0:
        finish(options, folder, told)


def finish(options: Options, folder: Path, told: dict[str, Any]) -> None:
    """Train on the blocks of `folder`, look at the errors and write the file."""
    kind = options.distribution
    rows, lobe, targets = blocks.loaded(folder, options.blocks)
    inputs = training.inputs_of(kind, rows)
    begun = files.read(options.start, {"metal": METAL}) if options.start else None
    weights = Weights(*(sizes_of(begun) if begun else (options.widths, options.each)), inputs)
    inputs, floor = weights.standardised(inputs), training.floors(kind, rows, targets[:, 0])
    cells = balanced(options, weights)
    if begun:
        vector = weights.unfolded(begun)
    else:
        with progress_bar("training", options.steps) as advance:
            saved = folder / "training.npz"
            vector = training.trained(
                weights, inputs, targets, floor, cells, options.steps, options.seed + 3, saved, advance
            )
    lobe = refinement.shares(lobe, targets[:, :4].sum(-1))
    data = refinement.Data(inputs, targets[:, 1:4].sum(-1), floor, lobe)
    with progress_bar("refinement", options.refinements) as advance:
        saved = folder / "refinement.npz"
        vector = refinement.refined(weights, vector, data, cells, options.refinements, options.seed + 5, saved, advance)
    others = max(options.steps // 5, 4)
    with progress_bar("other outputs", others) as advance:
        rest = refinement.others_anew(weights, vector, data, targets, others, advance)
    pair, each = weights.folded(vector, rest)
    found = files.Distillate(
        "metal", kind, options.alpha, *pair, {}, each, facets=met(options, rows, data, targets, pair)
    )
    errors = held_out.summary(
        MetalLobes(found),
        kind,
        options.alpha,
        options.seed + 4,
        options.held_out_points,
        options.held_out_paths,
    )
    certificate = certified(options, told, len(targets), errors)
    if begun:
        certificate["began with"] = {key: begun.certificate.get(key, "") for key in ("command", "commit")}
    files.write(options.out, found._replace(certificate=certificate), options.force)
    for name, values in errors.items():
        print(f"{name}: {values}")
    print(f"{options.out}: {options.out.stat().st_size} bytes")


def met(options: Options, rows: Rows, data: refinement.Data, targets: Tensor, pair: Net) -> Net:
    """The network of the facets that light meets."""
    some = slice(0, facets.ROWS)
    inputs, floor = training.inputs_of(options.distribution, rows.part(some)).pair, data.floor[some]
    heads = Heads(torch.stack(Network(*pair)(inputs.unbind(-1)), -1))
    weight = refinement.RELATIVE / (heads.level**2 + floor * floor) + data.lobe[some]
    with progress_bar("facets", options.facet_steps) as advance:
        return facets.fitted(
            inputs, targets, heads.rest, weight, options.facets, options.facet_steps, options.seed + 6, advance
        )


def balanced(options: Options, weights: Weights) -> energies.Cells:
    """The directions of incidence whose energies are balanced."""
    where = surfaces(options.alpha, options.cells, generator_for(options.seed + 1))
    pairs, cosines, lost = energies.pairs(options.distribution, where, options.seed + 2)
    return energies.Cells(weights.standardised(training.inputs_of(options.distribution, pairs)), cosines, lost)


def certified(options: Options, told: dict[str, Any], rows: int, errors: dict[str, Any]) -> dict[str, Any]:
    """What the file says of how it was made, and of how good it is."""
    return {
        "command": command_of("torchms.approximations.distil", options),
        "torchms": __version__,
        "torch": torch.__version__,
        "commit": commit(),
        "options": told | {"alpha": list(options.alpha), "widths": list(options.widths), "each": list(options.each)},
        "rows": rows,
        "paths": rows * 2 * sum(options.paths),
        "held_out": errors,
    }


def check(options: Options) -> None:
    """ValueError for options that do not fit."""
    check_alpha(options.alpha)
    limits = {
        "blocks": 1,
        "steps": 4,
        "refinements": 0,
        "facets": 1,
        "facet_steps": 1,
        "cells": training.CELLS,
        "held_out_points": 2,
    }
    check_least(options, limits)
    check_seed(options.seed)
    check_layers(widths=options.widths, each=options.each)
    if min(*options.paths, *options.held_out_paths) < 1:
        raise ValueError(f"--paths must be positive; got {options.paths} and {options.held_out_paths}.")


if __name__ == "__main__":
    run(main, Options)
