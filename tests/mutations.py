"""Ten deliberate faults in formulas, one at a time, and the test that catches each: `make mutations`.

Every fault is made in a copy of the tree in a temporary folder. Exits with 1 if a fault survives, or if its line is gone.
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
        "distribution.normal_density(h) / (4 * distribution.guarded_area(w))",
        "distribution.normal_density(h) / distribution.guarded_area(w)",
        ("tests/unit/test_vertex.py",),
    ),
    Fault(
        "η² of the refraction's Jacobian dropped",
        "paths/vertex.py",
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
        "bsdfs/base.py",
        "bsdf.scattering.walk(bsdf.vertex, wi, u), start=1)",
        "bsdf.scattering.walk(bsdf.vertex, wi, u), start=0)",
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
        "masking.py",
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
)


def caught_by(tree: Path, fault: Fault) -> str:
    """The first test that fails under `fault`; empty if none does. `tree` is left as it was."""
    file = tree / "torchms" / fault.file
    source = file.read_text()
    if source.count(fault.right) != 1:
        raise SystemExit(f"{fault.name}: {fault.file} has {source.count(fault.right)} times {fault.right!r}, not once")
    file.write_text(source.replace(fault.right, fault.wrong))
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *fault.tests],
            cwd=tree,
            env=os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        file.write_text(source)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{fault.name}: the tests did not run\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    found = re.search(r"^FAILED (.*?)(?: - |$)", done.stdout, re.M)
    return found.group(1) if found else ""


def main() -> int:
    wanted = sys.argv[1:]
    survived = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        tree.mkdir()
        for name in ("torchms", "tests"):
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
        for name in ("setup.cfg", "README.md"):
            shutil.copy(ROOT / name, tree / name)
        for fault in FAULTS:
            if wanted and not any(word in fault.name for word in wanted):
                continue
            start = time.perf_counter()
            test = caught_by(tree, fault)
            survived += not test
            print(f"{fault.name:42} {test or 'SURVIVED'}  ({time.perf_counter() - start:.0f} s)", flush=True)
    print("every fault is caught" if not survived else f"{survived} faults survived")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
