"""python -m torchms.microsurface.distil: light on Gaussian surfaces, and a file of lobes for `Distilled`."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch

from torchms.approximations import distilled_file as files
from torchms.approximations.distil.blocks import opened
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
from torchms.approximations.distil.processes import processes, threads_of, wait_for_all
from torchms.approximations.distil.training import inputs_of
from torchms.approximations.glass_features import SYMMETRIC
from torchms.cli.progress import progress_bar
from torchms.microsurface.distil import fit, glass, light
from torchms.microsurface.distil.kinds import KINDS
from torchms.storage.write import check_writable
from torchms.version import __version__


@dataclass
class Options:
    """Distil the light on Gaussian surfaces of metal, glass or diffuse facets: simulated paths, small networks, a file.

    A stopped run goes on where it was if it is called again. Under torchrun the light is simulated by all processes.
    """

    material: Literal["conductor", "dielectric", "diffuse"] = "conductor"
    """What the facets are of; glass (dielectric): of indices with a ratio in [1.3, 3], from either side."""
    alpha: tuple[float, float] = (0.1, 1.0)
    """Smallest and largest roughness."""
    out: Path = Path("gaussian.npz")
    """The file."""
    work: Path = Path("build/distil/gaussian")
    """Folder of blocks of light and of checkpoints."""
    blocks: int = 128
    """Tiles of a million texels, each with 131 072 paths."""
    steps: int = 4000
    """Adam's steps on the likelihood."""
    widths: tuple[int, ...] = (32, 24)
    """Units of the hidden layers; cost and accuracy follow them."""
    each: tuple[int, ...] = (16,)
    """Units of the hidden layers of the network of each direction."""
    seed: int = 100
    """Seed of everything."""
    threads: int | None = None
    """Threads of the simulation; one a core if it is not given."""
    force: bool = False
    """Overwrite the file."""


def main(options: Options) -> None:
    """Run all of it. Raises ValueError for options that do not fit, FileExistsError for a file that is there."""
    check(options)
    check_writable(options.out, options.force)
    rank, world = processes()
    told = {k: v for k, v in asdict(options).items() if k not in PLACES}
    about = {"alpha": list(options.alpha), "seed": options.seed, "material": options.material}
    opened(options.work, {"version": __version__, **about})
    numbers = list(range(rank, options.blocks, world))
    threads = threads_of(options.threads, world)
    if options.material == "dielectric":
        made = partial(light.gaussian_glass_block, options.alpha, options.seed)
    else:
        made = partial(light.gaussian_block, KINDS[options.material].facets, options.alpha, options.seed)
    with progress_bar("light", len(numbers)) as advance:
        light.made(options.work, numbers, made, threads, advance)
    wait_for_all(world)
    if rank == 0:
        finish(options, told)


def finish(options: Options, told: dict[str, Any]) -> None:
    """Learn from the blocks, and write the file."""
    found = light.loaded(options.work, options.blocks, options.seed)
    certificate = {
        "command": command_of("torchms.microsurface.distil", options),
        "torchms": __version__,
        "torch": torch.__version__,
        "commit": commit(),
        "options": {k: list(v) if isinstance(v, tuple) else v for k, v in told.items()},
        "paths": options.blocks * light.PATHS,
    }
    learned = glass_lobes if options.material == "dielectric" else lobes
    files.write(options.out, learned(options, found, certificate), options.force)
    print(f"{options.out}: {options.out.stat().st_size} bytes")


def lobes(options: Options, found: light.Light, certificate: dict[str, Any]) -> files.Distillate:
    """Those of facets that reflect."""
    kind, sizes = KINDS[options.material], (options.widths, options.each)
    subject = fit.Subject(partial(inputs_of, "Beckmann"), kind.smith, kind)
    (layers, skip), each = fit.learned(subject, found, sizes, options.steps, options.seed, options.work)
    return files.Distillate(
        f"gaussian{kind.suffix}", "Beckmann", options.alpha, layers, skip, certificate, each, kind.base()
    )


def glass_lobes(options: Options, found: light.Light, certificate: dict[str, Any]) -> files.Distillate:
    """Those of glass, reflected and transmitted."""
    sizes = options.widths, options.each
    reflected, transmitted = glass.learned(found, SYMMETRIC, None, sizes, options.steps, options.seed, options.work)
    (layers, skip), each = reflected
    return files.Distillate(
        *("gaussian_glass", "Beckmann", options.alpha, layers, skip, certificate, each),
        smith=glass.base(),
        through=transmitted,
        eta=light.RATIOS,
    )


def check(options: Options) -> None:
    """ValueError for options that do not fit."""
    check_alpha(options.alpha, 0.03, 1.0)
    check_least(options, {"blocks": 1, "steps": 1})
    check_seed(options.seed)
    check_layers(widths=options.widths, each=options.each)


if __name__ == "__main__":
    run(main, Options)
