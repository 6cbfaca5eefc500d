"""How far distilled glass is from the exact model where it was not trained: lobes on either side, and R + T, as tables.

python benchmarks/distilled_glass.py --distribution GGX [--files reflected.npz transmitted.npz]
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import tyro
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations.distil import glass_held_out
from torchms.approximations.distil.glass_held_out import ETAS, Table
from torchms.approximations.distil.held_out import ANGLES
from torchms.approximations.distilled import NETWORKS, packaged
from torchms.approximations.glass_lobes import GlassLobes


@dataclass
class Options:
    """Errors of distilled glass."""

    distribution: Literal["GGX", "Beckmann"] = "GGX"
    """Whose facets."""
    files: tuple[Path, Path] | None = None
    """What is reflected, and what is transmitted; the files of torchms if they are not given."""
    seed: int = 77
    """Of the references."""


def rows(table: Table) -> list[tuple[str, Tensor]]:
    """Names of groups of cells, and which cells they are."""
    where, n = table.where, torch.arange(len(table.energy))
    angle, eta = n % len(ANGLES), n // len(ANGLES) % len(ETAS)
    alpha = n // (len(ANGLES) * len(ETAS))
    found = [("all", n >= 0)]
    for k in range(int(alpha.max()) + 1):
        here = alpha == k
        found.append((f"alpha {float(where.ax[here][0]):g}, {float(where.ay[here][0]):g}", here))
    found += [(f"eta {value:.3f}", eta == k) for k, value in enumerate(ETAS)]
    return found + [(f"theta {value:g}", angle == k) for k, value in enumerate(ANGLES)]


def main(options: Options) -> None:
    """Print the median and the largest error of each group."""
    given = options.files
    found = (
        [packaged(options.distribution, facet) for facet in ("reflected", "transmitted")]
        if given is None
        else [files.read(path, NETWORKS) for path in given]
    )
    kind = options.distribution
    table = glass_held_out.table(GlassLobes(*found), kind, glass_held_out.cells(found[0].alpha), options.seed)
    print("| cells | reflected lobe | its noise | transmitted lobe | its noise | R + T - 1, rms and largest |")
    print("|---|---|---|---|---|---|")
    for name, some in rows(table):
        up, down, off = table.up, table.down, table.energy[some]
        columns = [f"{float(x[some].nanmedian()):.4f}, {float(x[some].nan_to_num(0).max()):.3f}" for x in (*up, *down)]
        print(
            f"| {name} | {' | '.join(columns)} | {float(off.square().mean().sqrt()):.4f}, {float(off.abs().max()):.3f} |"
        )


if __name__ == "__main__":
    main(tyro.cli(Options))
