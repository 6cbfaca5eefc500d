"""`torchms lut`: the tables of `torchms.dropins.split_sum` as files."""

import numpy as np

from torchms.cli.plain_options import LutOptions
from torchms.cli.progress import progress_bar
from torchms.dropins.split_sum import ALL_BOUNCES, COLUMNS, ONE_BOUNCE, all_bounces, one_bounce
from torchms.storage.write import check_writable, write_whole

MOST = 4096
"""Texels along an axis."""


def run_lut(options: LutOptions) -> None:
    """Write the table, and print what reads it. Raises ValueError or OSError for a size or a file that will not do."""
    if not 2 <= options.size <= MOST:
        raise ValueError(f"--size must lie in [2, {MOST}]; got {options.size}.")
    path = check_writable(options.out, options.force)
    every = options.bounces == "all"
    with progress_bar("table", options.size) as advance:
        table = (all_bounces if every else one_bounce)(options.size, advance)
    content = np.ascontiguousarray(table.numpy(), dtype="<f4").tobytes()
    write_whole(path, content, options.force)
    n = options.size
    print(f"{path}: {len(content)} bytes, float32, little endian, {' x '.join(map(str, table.shape))}")
    print(f"rows: roughness r, alpha = r * r; columns: N.V; centres at (i + 0.5) / {n}")
    if every:
        for name, part in (("a", COLUMNS[:4]), ("b", COLUMNS[4:])):
            print(f"plane {name}: {', '.join(part)}")
    else:
        print("a: scale, bias")
    print(f"GLSL, of texels at vec2(NdotV, roughness): {ALL_BOUNCES if every else ONE_BOUNCE}")
