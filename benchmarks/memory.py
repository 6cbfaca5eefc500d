"""Peak memory above inputs and outputs: 1e7 rows × 16 paths, and 1e7 × 64 with `--full`.

Every case runs in a process of its own, whose peak resident size is read before and after the call. Random numbers are a
`Stream`, which stores nothing. Prints a table and writes results/memory.json.

    python benchmarks/memory.py                # --rows 1e7 --paths 16
    python benchmarks/memory.py --full         # 64 paths as well: some minutes an entry
"""

import argparse
import ctypes
import json
import subprocess
import sys
import time
from typing import Any

import torch
from record import save

from torchms import GGX, Invariance, RoughConductor, SingleBounce, Stream, Unidirectional
from torchms.fresnel import Ideal

SCATTERINGS = {
    "SingleBounce": lambda: SingleBounce(),
    "Unidirectional(Invariance, 2)": lambda: Unidirectional(Invariance(), 2),
}


def resident(field: str) -> int:
    """VmRSS (now) or VmHWM (the most so far) of this process [bytes]."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) * 1024 for line in status if line.startswith(field))


def measure(scattering: str, rows: int, paths: int) -> dict[str, Any]:
    """The case, in this process."""
    torch.set_num_threads(1)
    bsdf = RoughConductor(GGX(0.4, 0.2), Ideal(), SCATTERINGS[scattering]())
    generator = torch.Generator().manual_seed(0)
    wi, wo = (torch.empty(3, rows).normal_(generator=generator) for _ in range(2))
    for w in (wi, wo):
        w /= (w * w).sum(0).sqrt_()
        w[2].abs_()
    small = wi[:, :64].T, wo[:, :64].T
    bsdf(*small, Stream(1, paths))  # what is loaded at the first call is not counted
    ctypes.CDLL(None).malloc_trim(0)  # nor what the allocator holds back of earlier temporaries
    before = resident("VmRSS")
    with open("/proc/self/clear_refs", "w") as clear:
        clear.write("5")  # the peak starts afresh
    start = time.perf_counter()
    value = bsdf(wi.T, wo.T, Stream(1, paths))
    elapsed = time.perf_counter() - start
    outputs = value.numel() * value.element_size()
    return {
        "scattering": scattering,
        "rows": rows,
        "paths": paths,
        "inputs": (wi.numel() + wo.numel()) * wi.element_size(),
        "outputs": outputs,
        "above": resident("VmHWM") - before - outputs,
        "seconds": elapsed,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=float, default=1e7)
    parser.add_argument("--paths", type=int, default=16)
    parser.add_argument("--full", action="store_true", help="64 paths as well")
    parser.add_argument("--case", nargs=3, metavar=("SCATTERING", "ROWS", "PATHS"), help="one case, as JSON")
    options = parser.parse_args()
    if options.case:
        scattering, rows, paths = options.case
        print(json.dumps(measure(scattering, int(rows), int(paths))))
        return
    found = []
    print(f"{'':32}{'rows':>10}{'paths':>7}{'in + out':>12}{'above':>12}{'time':>9}")
    for paths in [options.paths] + ([64] if options.full else []):
        for scattering in SCATTERINGS:
            case = ["--case", scattering, str(int(options.rows)), str(paths)]
            done = subprocess.run([sys.executable, __file__, *case], capture_output=True, text=True, check=True)
            row = json.loads(done.stdout)
            found.append(row)
            held = (row["inputs"] + row["outputs"]) / 1e6
            size = f"{row['rows']:10}{row['paths']:7}{held:9.0f} MB{row['above'] / 1e6:9.1f} MB"
            print(f"{scattering:32}{size}{row['seconds']:7.1f} s", flush=True)
    save("memory", found)


if __name__ == "__main__":
    main()
