"""Deliberate faults in formulas, one at a time, and the quick test that catches each: `make mutations [words of names]`.

Every fault is made in a copy of the tree in a temporary folder, where all named tests pass without it. Exits with 1 if a
fault survives, if its line is gone or if a test fails without a fault.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent


class Fault(NamedTuple):
    """What is put in place of what, where, and the narrowest tests that must notice."""

    name: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]


FAULTS = (
    Fault(
        "sign of Λ below the horizon",
        "distributions/base.py",
        "torch.where(w.z < 0, -magnitude, magnitude)",
        "torch.where(w.z < 0, magnitude, magnitude)",
        ("tests/unit/distributions/test_distributions.py",),
    ),
    Fault(
        "1/4 of the reflection's Jacobian missing",
        "paths/vertex.py",
        "distribution.density_along(v) / (4 * distribution.guarded_area(w))",
        "distribution.density_along(v) / distribution.guarded_area(w)",
        ("tests/unit/test_vertex.py",),
    ),
    Fault(
        "η² of the refraction's Jacobian dropped",
        "paths/refractive.py",
        "* wh * dh.abs() * (n * n), length2)",
        "* wh * dh.abs(), length2)",
        ("tests/unit/test_vertex.py",),
    ),
    Fault(
        "α_x and α_y exchanged",
        "distributions/base.py",
        "Vec3(ax * v.x, ay * v.y, v.z)",
        "Vec3(ay * v.x, ax * v.y, v.z)",
        ("tests/unit/distributions/test_distributions.py",),
    ),
    Fault(
        "order of a walk off by one",
        "bsdfs/kernels.py",
        "enumerate(bsdf._walk(wi, u), start=1)",
        "enumerate(bsdf._walk(wi, u), start=0)",
        ("tests/unit/test_bsdf.py",),
    ),
    Fault(
        "weight of multiple importance sampling",
        "paths/connection.py",
        "total = 1 + densities.backward * forward",
        "total = 2 + densities.backward * forward",
        ("tests/unit/test_law_suite.py", "-k", "white"),
    ),
    Fault(
        "bound k of the bounded normals",
        "distributions/ggx.py",
        "(1 - a2) * s2 / (s2 + a2 * (w.z * w.z))",
        "(1 - a2) * s2 / (s2 + a2 * w.z)",
        ("tests/unit/distributions/test_bounded.py",),
    ),
    Fault(
        "argument of the Beta function",
        "paths/masking.py",
        "torch.exp(log_beta_step(a, lam))",
        "torch.exp(log_beta_step(a, 1 + lam))",
        ("tests/unit/test_masking.py",),
    ),
    Fault(
        "knots of the energy table displaced",
        "approximations/albedo_table.py",
        't = polynomials(2 * view.t - 1, SHAPES["loss"][1] - 1)',
        't = polynomials(2 * view.t - 0.99, SHAPES["loss"][1] - 1)',
        ("tests/unit/test_albedo_table.py",),
    ),
    Fault(
        "constant of the hash",
        "sampling/stream.py",
        "0x846CA68B",
        "0x846CA68D",
        ("tests/unit/test_stream.py", "-k", "golden"),
    ),
    Fault(
        "spline knot",
        "distributions/gtr_closed.py",
        "bend = 6 * (y[2:] - 2 * y[1:-1] + y[:-2])",
        "bend = 6 * (y[2:] - 2 * y[1:-1] + y[1:-1])",
        ("tests/unit/distributions/test_gtr.py", "-k", "spline"),
    ),
    Fault(
        "sign in Fresnel's equations of a metal",
        "fresnel/conductor.py",
        "(below - 2 * (ac * s2))",
        "(below + 2 * (ac * s2))",
        ("tests/unit/fresnel/test_fresnel.py", "-k", "complex_formula"),
    ),
    Fault(
        "total reflection forgotten",
        "fresnel/dielectric.py",
        "return torch.where(total, 1.0, r_s",
        "return torch.where(total, 0.0, r_s",
        ("tests/unit/fresnel/test_fresnel.py", "-k", "dielectric"),
    ),
    Fault(
        "normalisation of Kulla–Conty",
        "approximations/kulla_conty.py",
        "energy.loss(w, side) * energy.loss(d, there) / energy.mean_loss(there)",
        "energy.loss(w, side) * energy.loss(d, there) * energy.mean_loss(there)",
        ("tests/laws/test_compensation.py", "-k", "the_furnace_is_white and ggx"),
    ),
    Fault(
        "factor of Turquin",
        "approximations/turquin.py",
        "(wi.z) * ((1 - E) / E))",
        "(wi.z) * (1 - E))",
        ("tests/laws/test_compensation.py", "-k", "the_furnace_is_white and ggx"),
    ),
    Fault(
        "escape of the height walk",
        "paths/height.py",
        "state.stay * torch.exp(leg.lam * log_U)",
        "state.stay * torch.exp(2 * leg.lam * log_U)",
        ("tests/unit/test_segment.py", "-k", "random_heights"),
    ),
    Fault(
        "weight of a proposal's mixture",
        "sampling/proposals.py",
        "(1 - q) * single + q * wo.z / math.pi",
        "q * single + (1 - q) * wo.z / math.pi",
        ("tests/laws/test_density.py", "-k", "1.0-0.25-ggx-conductor"),
    ),
    Fault(
        "radiance and importance exchanged",
        "bsdfs/rough_dielectric.py",
        "(wi.z > 0) == (wo.z > 0), 1.0, 1 / (eta * eta)",
        "(wi.z > 0) == (wo.z > 0), 1.0, eta * eta",
        ("tests/laws/test_reciprocity.py", "-k", "radiance_is_importance and correlated"),
    ),
    Fault(
        "split of a path at its highest collision",
        "paths/segments/invariance.py",
        "splits = range(i, j) if not state.monotone or i == j - 1 else (i, j - 1)",
        "splits = (i, j - 1) if i < j - 1 else range(i, j)",
        ("tests/unit/test_segment.py", "-k", "height_walk or refutes"),
    ),
    Fault(
        "share of a block of paths",
        "evaluation/blocks.py",
        "share = (paths.stop - paths.start) / self.n_paths",
        "share = (paths.stop - paths.start + 1) / self.n_paths",
        ("tests/unit/test_blocks.py", "-k", "conductor and invariance and forward"),
    ),
    Fault(
        "rows that machine code counts",
        "machine/driver.cpp",
        "to[i] = T(first + i * step)",
        "to[i] = T(first + (i + 1) * step)",
        ("tests/unit/test_engine.py", "-k", "any_rows"),
    ),
    Fault(
        "guards that machine code leaves out",
        "machine/truths.py",
        'if name == ("and" if is_true else "or"):',
        'if name in ("and", "or"):',
        ("tests/unit/test_simplify.py",),
    ),
    Fault(
        "last block of the evaluator of a file",
        "onnx/evaluator.py",
        "size = min(step, rows - a)",
        "size = min(step, rows - a - 1)",
        ("tests/onnx/test_files.py", "-k", "deterministic and conductor-3"),
    ),
    Fault(
        "counter of a stream",
        "sampling/stream.py",
        "torch.arange(rows.start, rows.stop, device=device) + (self.seed << 32)",
        "torch.arange(rows.stop - rows.start, device=device) + (self.seed << 32)",
        ("tests/unit/test_stream.py", "-k", "row or numbers"),
    ),
    Fault(
        "slope of a constrained parameter",
        "parameters/constrain.py",
        "self.low + (self.high - self.low) * torch.sigmoid(x)",
        "self.low + self.high * torch.sigmoid(x)",
        ("tests/unit/test_parametrize.py",),
    ),
)


def first_failure(tree: Path, tests: tuple[str, ...]) -> str:
    """The first of the quick tests that fails in `tree`; empty if none does."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *tests],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(tests)}: the tests did not run\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    found = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - |$)", done.stdout, re.M)
    return found.group(1) if found else ""


def caught_by(tree: Path, fault: Fault) -> str:
    """The first test that fails under `fault`; empty if none does. `tree` is left as it was."""
    file = tree / "torchms" / fault.file
    source = file.read_text()
    if source.count(fault.right) != 1:
        raise SystemExit(f"{fault.name}: {fault.file} has {source.count(fault.right)} times {fault.right!r}, not once")
    file.write_text(source.replace(fault.right, fault.wrong))
    try:
        return first_failure(tree, fault.tests)
    finally:
        file.write_text(source)


def main() -> int:
    wanted = sys.argv[1:]
    faults = [fault for fault in FAULTS if not wanted or any(word in fault.name for word in wanted)]
    if not faults:
        raise SystemExit(
            f"no fault has {' or '.join(wanted)} in its name; there are {', '.join(f.name for f in FAULTS)}"
        )
    survived = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        tree.mkdir()
        for name in ("torchms", "tests"):
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
        for name in ("setup.cfg", "README.md"):
            shutil.copy(ROOT / name, tree / name)
        print(f"{len(faults)} faults, each after its tests have passed without it:", flush=True)
        passed = set()
        for fault in faults:
            if fault.tests not in passed and (broken := first_failure(tree, fault.tests)):
                raise SystemExit(f"{broken} fails without a fault: nothing that it says of one counts")
            passed.add(fault.tests)
            start = time.perf_counter()
            test = caught_by(tree, fault)
            survived += not test
            print(f"{fault.name:42} {test or 'SURVIVED'}  ({time.perf_counter() - start:.0f} s)", flush=True)
    print("every fault is caught" if not survived else f"{survived} faults survived")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
