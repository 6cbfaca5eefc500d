"""Write heitz_lobes.npz beside this file: the reference lobes as counts over coarser cells.

    python tests/golden/coarsen_lobes.py ../shared/reference/heitz_lobes.npz

The original holds the mean of f·|cos θ_o| over 64 × 64 bins (cos θ × φ) and the number of walks n of each entry; times the
bin's solid angle and n that is the number of walks that ended there. Each entry becomes int32 (4, 16, 8) counts: order 1, 2, 3,
all orders; cos θ_o in 16 equal bins from −1 to 1, φ_o in 8 from 0 to 2π; and `<entry>_n`.
"""

import sys
from pathlib import Path

import numpy as np

BINS = (16, 8)


def coarse_counts(mean: np.ndarray, n: int) -> np.ndarray:
    """Counts (4, *BINS) of an entry (4, 64, 64)."""
    counts = np.rint(mean.astype(np.float64) * (4 * np.pi / mean[0].size) * n)
    return counts.reshape(4, BINS[0], 64 // BINS[0], BINS[1], 64 // BINS[1]).sum((2, 4)).astype(np.int32)


if __name__ == "__main__":
    source = np.load(sys.argv[1], allow_pickle=False)
    entries = {}
    for name in source.files:
        if f"{name}_n" in source.files:
            entries[name] = coarse_counts(source[name], int(source[f"{name}_n"]))
            entries[f"{name}_n"] = source[f"{name}_n"]
    np.savez_compressed(Path(__file__).with_name("heitz_lobes.npz"), **entries)
