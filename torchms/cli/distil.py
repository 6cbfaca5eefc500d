"""`torchms distil`: the lobe of a measured surface, learned from ray-traced light."""

import math
import shlex
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from torchms.approximations import distilled_file
from torchms.approximations.coordinates import ETA
from torchms.approximations.distil.glass_rows import LEAST_LOG
from torchms.cli.arguments import parse_count
from torchms.cli.plain_options import DistilOptions
from torchms.microsurface.distil import glass_scan, light, scan
from torchms.microsurface.surfaces.files import IMAGE_SUFFIXES
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.storage.write import check_writable, write_json

SILENT = (".npy", *IMAGE_SUFFIXES)
"""Files that say nothing of their units."""


def run_distil(options: DistilOptions) -> None:
    """Write the file, and print how far Smith's lobes and the learned ones are from held-out light.

    Raises ValueError or OSError for options, a surface or a file that will not do.
    """
    check_writable(options.out, options.force)
    if options.json is not None:
        check_writable(options.json, options.force)
    paths, held_out = parse_count(options.paths, "--paths", 1), parse_count(options.held_out, "--held-out", 2)
    if options.steps < 1:
        raise ValueError(f"--steps must be at least 1; got {options.steps}.")
    check_eta(options)
    surface = read(options)
    scan.check(surface, options.coarse)
    effort = scan.Effort(
        blocks=-(-paths // light.PATHS),
        steps=options.steps,
        seed=options.seed,
        material=options.material,
        eta=options.eta,
        held_out=held_out // 2,
        threads=options.threads,
    )
    of_material = glass_scan if options.material == "dielectric" else scan
    found = of_material.distilled(surface, options.work, effort, {"command": command(options)})
    if found is None:
        return
    distillate, rows = found
    distilled_file.write(options.out, distillate, options.force)
    if options.json is not None:
        write_json(options.json, {"command": command(options), "rows": rows}, options.force)
    show(rows)
    print(f"{options.out}: {options.out.stat().st_size} bytes; Distilled({str(options.out)!r})")


def check_eta(options: DistilOptions) -> None:
    """ValueError unless glass has an index, and nothing else does."""
    eta, glass = options.eta, options.material == "dielectric"
    if (eta is None) == glass:
        raise ValueError(
            "--material dielectric needs --eta, n inside / n outside, such as 1.5."
            if glass
            else f"--eta is of --material dielectric; {options.material} has none. Leave it out."
        )
    if eta is not None and not (1 / ETA <= eta <= ETA and abs(math.log(eta)) > LEAST_LOG):
        raise ValueError(
            f"--eta must lie in [1/{ETA:g}, {ETA:g}], of which Smith's lobes are known, and differ from 1 by 2 % or more; "
            f"got {eta:g}."
        )


def read(options: DistilOptions) -> Heightfield:
    """The surface of the options; ValueError if its units are not given."""
    lengths = {"--spacing": options.spacing, "--height-scale": options.height_scale}
    missing = [name for name, value in lengths.items() if value is None]
    if missing and options.surface.suffix.lower() in SILENT:
        raise ValueError(
            f"{options.surface} says nothing of its units: give {' and '.join(missing)}, the distance between neighbouring "
            "heights and the length of one step of their values, in one unit."
        )
    given = options.spacing
    if given is not None and len(given) not in (1, 2):
        raise ValueError(f"--spacing must be one or two numbers; got {len(given)}.")
    spacing = None if given is None else (given[0], given[-1])
    return Heightfield.from_file(options.surface, spacing, height_scale=options.height_scale, periodic=options.periodic)


def command(options: DistilOptions) -> str:
    """What makes the same lobes again."""
    words = ["torchms distil", f"--surface {shlex.quote(options.surface.name)}"]
    default = DistilOptions(surface=Path(), out=Path())
    for name in (
        "spacing",
        "height_scale",
        "material",
        "eta",
        "periodic",
        "coarse",
        "paths",
        "steps",
        "held_out",
        "seed",
    ):
        value = getattr(options, name)
        if value != getattr(default, name):
            said = " ".join(map(str, value)) if isinstance(value, tuple) else value
            words.append(f"--{name.replace('_', '-')}" + ("" if value is True else f" {said}"))
    return " ".join(words)


def show(rows: list[dict[str, Any]]) -> None:
    """A table: each direction of incidence, and the error of each lobe."""
    table = Table(title="RMS error of the lobe, of its own RMS [%]; largest gap of an order's energy [1e-4]")
    models = [name for name in scan.MODELS if name in rows[0]]
    glass = "leaves" in rows[0]
    for heading in (*(("light from", "leaves") if glass else ()), "theta", "phi", *models, "noise"):
        table.add_column(heading, justify="right")
    for row in rows:
        cells = []
        for name in models:
            gap = glass_scan.gap(row, name) if glass else scan.gap(row, name)
            cells.append(f"{100 * row[name]['lobe_error']:.2f}; {1e4 * gap:.0f}")
        noise = f"{100 * row[scan.MODELS[0]]['noise']:.2f}; {1e4 * max(row['energy_noise']):.0f}"
        sides = (row["from"], row["leaves"]) if glass else ()
        table.add_row(*sides, f"{row['theta']:.2f}", f"{row['phi']:.2f}", *cells, noise)
    Console(width=110).print(table)
