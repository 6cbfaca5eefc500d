"""Figures of the pages of the theory, docs/images/theory/*.png; a minute or two of one core.

python benchmarks/theory_figures.py            # all
python benchmarks/theory_figures.py masking    # one of them
"""

import argparse
import io
from pathlib import Path

import torch
from theory_curves import distilled, heights, orders, smith, staircase, through_glass
from theory_drawings import glass, masking, path

from torchms.storage.write import write_whole

FIGURES = {
    drawn.__name__: drawn
    for drawn in (masking, path, heights, orders, glass, through_glass, staircase, distilled, smith)
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(FIGURES)}; all without")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "docs" / "images" / "theory")
    options = parser.parse_args()
    unknown = set(options.names) - FIGURES.keys()
    if unknown:
        parser.error(f"no such figure: {', '.join(sorted(unknown))}; there are {', '.join(FIGURES)}.")
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or FIGURES:
        with torch.no_grad(), io.BytesIO() as buffer:
            FIGURES[name]().savefig(buffer, format="png", metadata={"Software": None})
            write_whole(options.out / f"{name}.png", buffer.getvalue(), True)
        print(options.out / f"{name}.png")


if __name__ == "__main__":
    main()
