"""What the commands that distil glass and diffuse facets share: options, blocks of data, the file with its certificate."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import torch
import tyro
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations.distil.blocks import opened
from torchms.approximations.distil.cached import blocks
from torchms.approximations.network import Layer
from torchms.cli.exit_code import exit_code
from torchms.cli.progress import progress_bar
from torchms.storage.write import check_writable
from torchms.version import __version__

PLACES = ("out", "outs", "work", "force", "threads")
"""Options that the lobes do not depend on."""


@dataclass
class Common:
    """Options of every distillation."""

    distribution: Literal["GGX", "Beckmann"] = "GGX"
    """Whose facets."""
    alpha: tuple[float, float] = (0.03, 1.0)
    """Smallest and largest roughness."""
    work: Path = Path("build/distil")
    """Folder of blocks of data."""
    seed: int = 1
    """Seed of everything."""
    blocks: int = 24
    """Blocks of data."""
    force: bool = False
    """Overwrite the files."""

    later: ClassVar[tuple[str, ...]] = ()
    """Options that the blocks of data do not depend on."""

    @property
    def told(self) -> dict[str, Any]:
        """What the result depends on."""
        return {k: v for k, v in asdict(self).items() if k not in PLACES}

    def write(
        self,
        facet: str,
        out: Path,
        layers: list[Layer],
        skip: Tensor,
        rows: int,
        paths: int,
        errors: dict[str, Any],
        folder: Path,
        each: tuple[list[Layer], Tensor] | None = None,
    ) -> None:
        """Put a file with its certificate at `out`."""
        certificate = {
            "command": command_of(f"torchms.approximations.distil.{folder.name}", self),
            "torchms": __version__,
            "torch": torch.__version__,
            "commit": commit(),
            "options": {k: list(v) if isinstance(v, tuple) else v for k, v in self.told.items()},
            "rows": rows,
            "paths": rows * paths,
            "held_out": errors,
        }
        found = files.Distillate(facet, self.distribution, self.alpha, layers, skip, certificate, each)
        files.write(out, found, self.force)
        print(f"{out}: {out.stat().st_size} bytes; {errors}")


C = TypeVar("C")


def told(options: Common, facet: str, made: Callable[[int], dict[str, Tensor]]) -> tuple[dict[str, Tensor], Path]:
    """The blocks of data, made as far as they are not there, and their folder."""
    check_alpha(options.alpha)
    check_least(options, {"blocks": 1})
    check_seed(options.seed)
    for name in ("out", "outs"):
        value = getattr(options, name, ())
        for path in value if isinstance(value, tuple) else (value,):
            check_writable(path, options.force)
    folder = options.work / options.distribution / facet
    begun = {name: value for name, value in options.told.items() if name not in (*options.later, "blocks")}
    opened(folder, {"version": __version__, "format": files.FORMAT, **begun})
    with progress_bar("blocks of data", options.blocks) as advance:
        return blocks(folder, options.blocks, made, advance), folder


def check_alpha(alpha: tuple[float, float], least: float = 1e-3, most: float = 2.0) -> None:
    """ValueError for what is no range of roughness in [least, most]."""
    low, high = alpha
    if not least <= low < high <= most:
        raise ValueError(
            f"--alpha must be two numbers in [{least:g}, {most:g}], the smaller one first; got {low:g} {high:g}."
        )


def check_least(options: Any, limits: Mapping[str, int]) -> None:
    """ValueError for an option below its limit."""
    for name, least in limits.items():
        if getattr(options, name) < least:
            raise ValueError(f"--{name.replace('_', '-')} must be at least {least}; got {getattr(options, name)}.")


def check_seed(seed: int) -> None:
    """ValueError for one that some number is added to, and that must stay one."""
    if not 0 <= seed < 1 << 16:
        raise ValueError(f"--seed must lie in [0, 65536); got {seed}.")


def check_layers(**layers: tuple[int, ...]) -> None:
    """ValueError for units of hidden layers, by the name of the option, that no file holds."""
    for name, widths in layers.items():
        if not widths or min(widths) < 1 or len(widths) >= files.MOST_LAYERS:
            raise ValueError(f"--{name} must be 1 to {files.MOST_LAYERS - 1} positive numbers; got {widths}.")


def command_of(module: str, options: Any) -> str:
    """What makes the same lobes again: the options that differ from the default, but for places and threads."""
    words = [f"python -m {module}"]
    for each in fields(options):
        value = getattr(options, each.name)
        if each.name not in PLACES and value != each.default and isinstance(value, bool):
            words.append(f"--{each.name.replace('_', '-')}")
        elif each.name not in PLACES and value != each.default:
            numbers = value if isinstance(value, tuple) else (getattr(value, "name", value),)
            words.append(f"--{each.name.replace('_', '-')} {' '.join(map(str, numbers))}")
    return " ".join(words)


@contextlib.contextmanager
def finished(label: str, steps: int) -> Iterator[Callable[[int], None]]:
    """A progress bar of so many steps, in which no graph is recorded."""
    with progress_bar(label, steps) as advance, torch.no_grad():
        yield advance


def run(main: Callable[[C], None], kind: type[C]) -> None:
    """`main` with options of the command line; errors that a user can mend are one line on stderr."""
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)))
    code = exit_code("distil", lambda: main(tyro.cli(kind)), "call it again with the same options to go on.")
    if code:
        sys.exit(code)


def commit() -> str:
    """Of the repository that this is run in; "" outside of one."""
    command = ["git", "describe", "--always", "--dirty"]
    try:
        return subprocess.run(
            command, capture_output=True, text=True, cwd=Path(__file__).parent, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
