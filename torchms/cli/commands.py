"""The command line: `torchms` or `python -m torchms`."""

import sys
from collections.abc import Callable
from importlib import import_module

import tyro

from torchms.cli.exit_code import exit_code
from torchms.cli.options import (
    EnergyOptions,
    ExportOptions,
    FiguresOptions,
    RenderOptions,
    SimulateOptions,
)
from torchms.cli.plain_options import DistilOptions, FitMeasuredOptions, LabOptions, LutOptions
from torchms.version import __version__

COMMANDS: dict[str, tuple[type, str]] = {
    "energy": (EnergyOptions, "torchms.cli.energy:run_energy"),
    "simulate": (SimulateOptions, "torchms.cli.simulate:run_simulate"),
    "figures": (FiguresOptions, "torchms.cli.figures:run_figures"),
    "render": (RenderOptions, "torchms.cli.render:run_render"),
    "export": (ExportOptions, "torchms.cli.export:run_export"),
    "lab": (LabOptions, "torchms.cli.lab:run_lab"),
    "lut": (LutOptions, "torchms.cli.lut:run_lut"),
    "distil": (DistilOptions, "torchms.cli.distil:run_distil"),
    "fit-measured": (FitMeasuredOptions, "torchms.cli.fit_measured:run_fit_measured"),
}
"""Name of a command, its options, and the function that runs it, imported only then."""


DESCRIPTION = """Multiple-bounce microfacet BSDFs: energies, simulations, pictures, tables, ONNX files, a page.

Example: torchms energy --material conductor --metal Au --alpha 0.5

`torchms --version` prints the version.
"""


def _function(path: str) -> Callable[[object], None]:
    module, name = path.split(":")
    return getattr(import_module(module), name)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit code is 0, 2 for arguments that do not fit, 130 when interrupted."""
    given = sys.argv[1:] if arguments is None else arguments
    return exit_code("torchms", lambda: _run(given), "no result was written.")


def _run(arguments: list[str]) -> int:
    if arguments == ["--version"]:
        print(f"torchms {__version__}")
        return 0
    options = tyro.extras.subcommand_cli_from_dict(
        {name: options for name, (options, _) in COMMANDS.items()},
        prog="torchms",
        description=DESCRIPTION,
        args=arguments,
    )
    run = next(path for kind, path in COMMANDS.values() if isinstance(options, kind))
    _function(run)(options)
    return 0
