"""The reference tables of tests/golden, row by row."""

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from cases import ELLIPTIC, LOSSLESS, MATERIALS, SCATTERINGS, direction, serves

from torchms import BSDF
from torchms.testing import Estimate

GOLDEN = Path(__file__).parents[1] / "golden"
SHARED = Path(__file__).parents[3] / "shared" / "reference"
ENERGY = json.loads((GOLDEN / "heitz_energy.json").read_text())
ROWS: dict[str, dict[str, Any]] = {
    f"{r['material']}-{r['distribution']}-{','.join(f'{a:g}' for a in r['alpha'])}-{r['theta_i']:g}": r
    for r in ENERGY["rows"]
}
ORACLES = ("height-walk", "invariance")
BIASED = ("uncorrelated", "correlated")


@functools.cache
def lobes() -> Any:
    """The npz file of coarse lobes, open."""
    return np.load(GOLDEN / "heitz_lobes.npz", allow_pickle=False)


def lobe_counts(row: dict[str, Any]) -> Estimate:
    """Share of the energy in each cell, (4, n_cos, n_phi)."""
    ax, ay = row["alpha"]
    name = f"{row['material']}_{row['distribution']}_a{ax:g}_{ay:g}_t{row['theta_i']:g}"
    n = int(lobes()[f"{name}_n"])
    return counted(torch.from_numpy(lobes()[name]).double() / n, n)


def counted(share: torch.Tensor, n: int) -> Estimate:
    """A share that was found by counting `n` walks."""
    return Estimate(share, (share * (1 - share) / n).clamp_min(0).sqrt(), n)


def model(row: dict[str, Any], scattering: str, max_order: int = 10) -> BSDF:
    """The BSDF that the row describes."""
    facets = ELLIPTIC[row["distribution"]](*row["alpha"])
    return MATERIALS[LOSSLESS[row["material"]]](facets, SCATTERINGS[scattering](max_order))


def incident(row: dict[str, Any]) -> torch.Tensor:
    """wi of the row."""
    return direction(row["theta_i"], 0.0, torch.float32)


def oracles(default: int, slow: int) -> pytest.MarkDecorator:
    """Parametrize over row × exact model, with a few walks and, slow, with many."""
    cases = [
        pytest.param(
            name, scattering, n, marks=[pytest.mark.slow] if n == slow else [], id=f"{name}-{scattering}-{n:.0e}"
        )
        for n in (default, slow)
        for name, row in ROWS.items()
        for scattering in ORACLES
        if serves(LOSSLESS[row["material"]], scattering)
    ]
    return pytest.mark.parametrize("name,scattering,n_paths", cases)


def checksum(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
