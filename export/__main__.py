"""Write a set of ONNX files and check each against eager.

    python -m export --out build/onnx

The exit code is 1 if a bound is missed, 2 for arguments that do not fit.
"""

import platform
import sys
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from torchms.cli.surface import Scattering

FlagOnly = tyro.conf.FlagCreatePairsOff


@dataclass(frozen=True)
class Options:
    """Write a set of ONNX evaluators, check each against eager, and print the parity table."""

    out: Path = Path("build/onnx")
    """Folder for the files; it is made if it does not exist."""
    materials: tuple[Literal["conductor", "dielectric", "diffuse"], ...] = ("conductor", "dielectric", "diffuse")
    """Materials of the set."""
    distributions: tuple[Literal["ggx", "beckmann"], ...] = ("ggx", "beckmann")
    """Distributions of the set."""
    scatterings: tuple[Scattering, ...] = ()
    """Scatterings of the set; all if none is named."""
    what: tuple[Literal["forward", "orders", "sample", "pdf"], ...] = ("forward", "orders", "sample", "pdf")
    """What is evaluated. sample and pdf do not depend on the scattering: they are written once a material."""
    max_order: int = 3
    """Bounces to count."""
    n_paths: int = 2
    """Paths of an evaluation."""
    rows: int = 1 << 18
    """Rows of the grid that is compared."""
    json: Path | None = None
    """Write the table's numbers to this file."""
    force: Annotated[bool, FlagOnly] = False
    """Overwrite files."""


PARAMETERS = {
    "conductor": ("alpha", "alpha_y", "eta", "k"),
    "dielectric": ("alpha", "alpha_y", "eta"),
    "diffuse": ("alpha", "alpha_y", "albedo"),
}
"""Inputs of the files beside directions and random numbers: everything that a surface has."""


def entries(options: Options):
    """Write and compare file after file."""
    from torchms.cli.export import build
    from torchms.cli.options import ExportOptions
    from torchms.onnx.exporter import checked, exported
    from torchms.onnx.parity.compare import check
    from torchms.onnx.parity.table import Entry
    from torchms.storage.write import write_whole

    for distribution in options.distributions:
        for material in options.materials:
            shared = [w for w in options.what if w in ("sample", "pdf")]
            jobs: list[tuple[Any, str, str]] = [("single-bounce", w, f"{material}-{distribution}-{w}") for w in shared]
            for scattering in options.scatterings or get_args(Scattering):
                for what in options.what:
                    if what not in shared:
                        jobs.append((scattering, what, f"{material}-{distribution}-{scattering}-{what}"))
            for scattering, what, name in jobs:
                path = options.out / f"{name}.onnx"
                description = ExportOptions(
                    str(path),
                    material=material,
                    metal="Cu" if material == "conductor" else None,
                    distribution=distribution,
                    scattering=scattering,
                    max_order=options.max_order,
                )
                # eta and k do not enter the density of a metal.
                inputs = PARAMETERS[material]
                if what in ("sample", "pdf"):
                    inputs = inputs[:3] if material == "dielectric" else inputs[:2]
                arguments = {"what": what, "parameters": inputs, "n_paths": options.n_paths}
                start = time.perf_counter()
                try:
                    bsdf = build(description)
                    content = exported(bsdf, **arguments)
                except ValueError as error:
                    yield Entry(name, refused=" ".join(str(error).split()))
                    continue
                seconds = time.perf_counter() - start
                graph = checked(bsdf, uniforms="input", **arguments)
                parity = check(content, graph, options.rows)
                write_whole(path, content, options.force)
                yield Entry.of(name, content, parity, round(seconds, 1))


def run(options: Options) -> int:
    """Write the set and the table; 1 if a bound is missed, else 0."""
    from torchms.onnx.parity.table import FOOTNOTE, table
    from torchms.storage.write import check_writable, write_json

    done = []
    if options.json is not None:
        check_writable(options.json, options.force)
    options.out.mkdir(parents=True, exist_ok=True)
    for entry in entries(options):
        done.append(entry)
        lines = table([entry]).splitlines()
        print("\n".join(lines if len(done) == 1 else lines[2:]), flush=True)
    print(FOOTNOTE)
    if options.json is not None:
        record = {
            "question": "Do the exported evaluators give the numbers of eager?",
            "command": "python -m export",
            "machine": {"cpu": platform.machine(), "python": platform.python_version()},
            "versions": {name: metadata.version(name) for name in ("torch", "onnx", "onnxscript", "onnxruntime")},
            "timings": "provisional: one thread each, other work on the machine at the same time",
            "files": [entry.as_json() for entry in done],
        }
        write_json(options.json, record, options.force)
    failed = [entry.name for entry in done if entry.failed]
    print(f"{len(done)} files, {len(failed)} missed a bound" + (f": {', '.join(failed)}" if failed else "."))
    return 1 if failed else 0


def main() -> int:
    """Run; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    from torchms.cli.exit_code import exit_code

    return exit_code("export", lambda: run(options), "the files that were checked are in place.")


if __name__ == "__main__":
    sys.exit(main())
