"""`torchms.compile`: the same BSDF, its kernels as machine code."""

import copy
import warnings
from typing import TypeVar

from torchms.bsdfs.base import BSDF
from torchms.evaluation.engine import Engine
from torchms.machine.build import missing_compiler

B = TypeVar("B", bound=BSDF)

# Inductor recomputes an intermediate in every kernel that reads it until it counts this many operations, then gives it
# a name. Bounces read each other's results so often that its default (30) multiplies the work of the compiler by twenty;
# named results inside one loop cost nothing. The loop must then not be cut at 64 names.
OPTIONS = {"realize_opcount_threshold": 6, "max_fusion_size": 1_000_000, "cpp.dynamic_threads": True}
"""Options for a `torch.compile` of one's own around eager calls."""


def compile(bsdf: B, *, verbose: bool = True, exact: bool = False) -> B:
    """`bsdf` with its evaluations as machine code; it shares the parameters, and every method keeps its signature.

    The first call of each method, and its first backward, compiles it (seconds, shown on stderr if `verbose`); results are
    cached on disk between processes in TORCHINDUCTOR_CACHE_DIR. Any batch shape, number of paths and per-pixel parameter
    runs through the same machine code, and so does another BSDF of the same classes: one may be built and compiled anew in
    every step of a training, around what a network gave. Rows are shared among `torch.get_num_threads()` threads; the bits
    do not depend on them. `backward` stores the inputs only, and computes the rest again; a second derivative is computed
    eagerly, as everything is under `torch.func` and for tensors that are not on the CPU.
    exact: products and sums are rounded one by one, quotients and roots correctly, as in eager mode; without it they are
    within a few units in the last place of that, and faster.
    Where no C++ compiler works, or the parameters are not on the CPU, warns once and gives back a BSDF that runs eagerly.
    Raises TypeError if `bsdf` is not a BSDF.
    """
    if not isinstance(bsdf, BSDF):
        raise TypeError(f"compile(bsdf) takes a BSDF such as RoughConductor(...); got {type(bsdf).__name__}.")
    fast = copy.copy(bsdf)
    missing = _missing_compiler()
    if missing:
        warnings.warn(
            f"torchms.compile: no working C++ compiler ({missing}); the BSDF runs eagerly, in blocks. "
            "Install g++ or clang++, or name one in the variable CXX.",
            RuntimeWarning,
            stacklevel=2,
        )
        return fast
    elsewhere = sorted({x.device.type for x in (*bsdf.parameters(), *bsdf.buffers())} - {"cpu"})
    if elsewhere:
        warnings.warn(
            f"torchms.compile: parameters are on {', '.join(elsewhere)}, and machine code is for the CPU; the BSDF runs eagerly. "
            "Move it with bsdf.cpu(), or compile the calls with torch.compile.",
            RuntimeWarning,
            stacklevel=2,
        )
    fast.engine = Engine(verbose, exact)
    return fast


def _missing_compiler() -> str:
    return missing_compiler()
