"""The sums of all shards as a `Tally`: means, standard errors from the spread of the groups, diagnostics."""

import math

import numpy as np
import torch

from torchms.lobes.tally import Lobes, Tally
from torchms.microsurface.simulation.partial import COUNTERS, Partial
from torchms.microsurface.simulation.plan import Plan


def tally(plan: Plan, total: Partial) -> Tally:
    """The result of all shards; `info` holds the configuration and the diagnostics, not the speed."""
    rays = total.counts[:, 0].astype(np.float64)
    reflected, transmitted = _mean(total.reflected, rays), _mean(total.transmitted, rays)
    out = _mean(total.reflected.sum(1) + total.transmitted.sum(1), rays)
    remaining, leaked = _mean(total.remaining, rays), _mean(total.leaked, rays)
    lost, absorbed = _mean(total.remaining + total.leaked, rays), 1 - out[0] - remaining[0] - leaked[0]
    segments = int(total.counts[:, COUNTERS.index("segments")].sum())
    lobes = None
    if plan.lobes:
        mean, stderr = _mean(total.lobes, rays)
        per_sr = mean.shape[1] * mean.shape[2] / (4 * math.pi)
        lobes = Lobes(torch.from_numpy(mean * per_sr), torch.from_numpy(stderr * per_sr))
    variance = total.measured[:, :2]
    info = {
        "configuration": plan.configuration(),
        "lost": lost[0].tolist(),
        "lost_stderr": lost[1].tolist(),
        "leaked": leaked[0].tolist(),
        # Rounding of 1 − Σ is not absorption.
        "absorbed": np.where(np.abs(absorbed) < 1e-8, 0.0, absorbed).tolist(),
        "leak_rate": int(total.counts[:, COUNTERS.index("leaked_segments")].sum()) / max(segments, 1),
        "stderr_over": f"{plan.n_groups} surfaces" if plan.n_surfaces > 1 else f"{plan.n_groups} groups of rays",
        "slopes": {
            "variance": variance.mean(0).tolist(),
            "alpha": np.sqrt(2 * variance.mean(0)).tolist(),
            "distance_to_beckmann": total.measured[:, 2:].mean(0).tolist(),
            "variance_per_surface": variance.tolist(),
        },
    } | {name: int(total.counts[:, i].sum()) for i, name in enumerate(COUNTERS)}
    names = ("reflected", "transmitted", "total", "remaining")
    pairs = dict(zip(names, (reflected, transmitted, out, remaining), strict=True))
    energies = {name: torch.from_numpy(mean) for name, (mean, _) in pairs.items()}
    errors = {f"{name}_stderr": torch.from_numpy(stderr) for name, (_, stderr) in pairs.items()}
    return Tally(
        **energies,
        **errors,
        n=int(rays.sum()),
        lobes=lobes,
        info=info,
    )


def _mean(energy: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over all rays and its standard error from the spread of the groups (infinite if there is one)."""
    from torchms.microsurface.simulation.settle import UNIT

    groups, total = len(rays), rays.sum()
    shape = (groups,) + (1,) * (energy.ndim - 1)
    mean = energy.sum(0).astype(np.float64) / (UNIT * total)
    if groups < 2:
        return mean, np.full_like(mean, math.inf)
    share = (rays / total).reshape(shape)
    difference = energy / (UNIT * rays.reshape(shape)) - mean
    return mean, np.sqrt((share**2 * difference**2).sum(0) * groups / (groups - 1))
