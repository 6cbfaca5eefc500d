"""Trace the surfaces of the figures and store their lobes for the lobe lab: 3 materials x 4 roughnesses x 4 angles.

python -m export.lab_tallies --out export/lab/public/microsurface.json
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

ALPHAS = ((0.25, 0.25), (0.5, 0.5), (1.0, 1.0), (1.0, 0.1))
THETAS = (0.0, 0.5, 1.0, 1.5)
DIGITS = 4


@dataclass(frozen=True)
class Options:
    """Simulate and write one JSON file."""

    out: Path = Path("export/lab/public/microsurface.json")
    """The file."""
    rays: float = 5e5
    """Light paths a case."""
    surfaces: int = 8
    """Independent surfaces; the standard errors are their spread."""
    size: int = 1024
    """Texels along each edge of a surface."""
    seed: int = 1
    """Seed of everything."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the file."""


def rounded(value: Any) -> Any:
    """Numbers with a few significant digits: the noise is larger."""
    return [rounded(v) for v in value] if isinstance(value, list) else float(f"{value:.{DIGITS}g}")


def traced(material: str, alpha: tuple[float, float], theta: float, options: Options) -> dict[str, Any]:
    """One case: angle [rad], value and standard error [1/sr] (5, n) of 1, 2, 3, 4 or more and all bounces; energies [1]."""
    from torchms.microsurface.rays.grid_walk import GridTracer
    from torchms.microsurface.simulation.comparison import Case, energies, plane_of_incidence

    case = Case(material, alpha, theta)
    tally = case.simulated(options.surfaces, options.size, options.rays, options.seed, GridTracer())
    angle, value, stderr = plane_of_incidence(tally, case.phi)
    found = energies(tally)
    shares = {side: [*found[side][:3], sum(found[side][3:])] for side in ("reflected", "transmitted")}
    return {
        "material": material,
        "alpha": list(alpha),
        "theta": theta,
        **{name: rounded(x.tolist()) for name, x in {"angle": angle, "value": value, "stderr": stderr}.items()},
        **{name: rounded(x) for name, x in shares.items()},
    }


def write(options: Options) -> None:
    """Trace all cases, then write the file."""
    from torchms.storage.write import check_writable, write_whole
    from torchms.version import __version__

    check_writable(options.out, options.force)
    cases = []
    for material in ("conductor", "dielectric", "diffuse"):
        for alpha in ALPHAS:
            for theta in THETAS:
                cases.append(traced(material, alpha, theta, options))
                print(material, alpha, theta, flush=True)
    content = {
        "what": "Gaussian heightfields (Beckmann), light paths traced: F = 1, eta = 1.5, albedo 1; azimuth 0",
        "command": f"python -m export.lab_tallies --rays {options.rays:g} --surfaces {options.surfaces} "
        f"--size {options.size} --seed {options.seed}",
        "torchms": __version__,
        "bounces": ["1", "2", "3", "4+", "all"],
        "cases": cases,
    }
    write_whole(options.out, json.dumps(content, separators=(",", ":")).encode(), options.force)


def main() -> int:
    """Run; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    from torchms.cli.exit_code import exit_code

    return exit_code("export", lambda: write(options), "no file was written.")


if __name__ == "__main__":
    sys.exit(main())
