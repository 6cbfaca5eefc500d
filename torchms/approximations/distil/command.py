"""What the commands that distil glass and diffuse facets share: options, blocks of data, the file with its certificate."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
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
        return {k: v for k, v in asdict(self).items() if k not in ("out", "outs", "work", "force")}

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
        default = {f.name: f.default for f in fields(self)}
        words = [
            f"--{k} {' '.join(map(str, v)) if isinstance(v, tuple) else v}"
            for k, v in self.told.items()
            if v != default[k]
        ]
        certificate = {
            "command": " ".join([f"python -m torchms.approximations.distil.{folder.name}", *words]),
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
    low, high = options.alpha
    if not 1e-3 <= low < high <= 2:
        raise ValueError(f"--alpha must be two numbers in [1e-3, 2], the smaller one first; got {low:g} {high:g}.")
    if options.blocks < 1:
        raise ValueError(f"--blocks must be at least 1; got {options.blocks}.")
    if not 0 <= options.seed < 1 << 16:
        raise ValueError(f"--seed must lie in [0, 65536); got {options.seed}.")
    for name in ("out", "outs"):
        value = getattr(options, name, ())
        for path in value if isinstance(value, tuple) else (value,):
            check_writable(path, options.force)
    folder = options.work / options.distribution / facet
    begun = {name: value for name, value in options.told.items() if name not in (*options.later, "blocks")}
    opened(folder, {"version": __version__, "format": files.FORMAT, **begun})
    with progress_bar("blocks of data", options.blocks) as advance:
        return blocks(folder, options.blocks, made, advance), folder


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
