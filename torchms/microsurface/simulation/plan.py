"""A simulation as numbered shards with their own seeds: what to run, in which pieces, and how the pieces add up."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch

from torchms.lobes.tally import Lobes, Tally
from torchms.microsurface.rays.grid import Grid, Paths
from torchms.microsurface.rays.tracer import Caster, TraceCount, Tracer
from torchms.microsurface.simulation.materials import FacetMaterial
from torchms.microsurface.simulation.seeds import shard_key, surface_seed
from torchms.microsurface.surfaces.heightfield import GaussianSurfaces, Heightfield

# Raise when a change of the code changes the numbers: checkpoints of another format are refused.
FORMAT = 1
# A single surface has no spread over surfaces; its rays are dealt into this many groups instead.
GROUPS_OF_ONE_SURFACE = 16
COUNTERS = ("rays", "segments", "casts", "repeats", "leaked_segments")
MEASURED = ("slope_variance_x", "slope_variance_y", "slope_distance_x", "slope_distance_y")


@dataclass(frozen=True)
class Shard:
    """A piece of the work: `rays` rays on surface `surface`, the `part`-th shard of that surface."""

    number: int
    surface: int
    part: int
    rays: int


@dataclass
class Partial:
    """What some of the shards found, in whole numbers (steps of 1/UNIT of a path's energy): sums depend on no order.

    The first axis of the energies is the group that standard errors are taken over, see `Plan.group`.
    """

    reflected: np.ndarray
    transmitted: np.ndarray
    rest: np.ndarray
    leaked: np.ndarray
    lobes: np.ndarray
    counts: np.ndarray
    measured: np.ndarray

    @staticmethod
    def zeros(groups: int, surfaces: int, orders: int, channels: int, lobes: bool) -> "Partial":
        """Nothing found yet."""
        from torchms.microsurface.simulation.facets import N_COS, N_PHI, PLANES

        planes = PLANES if lobes else 0
        return Partial(
            reflected=np.zeros((groups, orders, channels), dtype=np.int64),
            transmitted=np.zeros((groups, orders, channels), dtype=np.int64),
            rest=np.zeros((groups, channels), dtype=np.int64),
            leaked=np.zeros((groups, channels), dtype=np.int64),
            lobes=np.zeros((groups, planes, N_COS, N_PHI, channels), dtype=np.int64),
            counts=np.zeros((groups, len(COUNTERS)), dtype=np.int64),
            measured=np.zeros((surfaces, len(MEASURED))),
        )

    def arrays(self) -> dict[str, Any]:
        """All arrays by name."""
        return dict(vars(self))

    def add(self, found: "Partial", group: int, surface: int) -> None:
        """Add the result of one shard (one group, one surface)."""
        for name, mine in self.arrays().items():
            theirs = found.arrays()[name][0]
            if name == "measured":
                mine[surface] = theirs
            else:
                mine[group] += theirs


@dataclass(frozen=True)
class Plan:
    """Everything that fixes the result of a simulation, see `simulate`, and the shards it is cut into."""

    surface: Heightfield | Sequence[Heightfield] | GaussianSurfaces
    material: FacetMaterial
    wi: np.ndarray
    n_rays: int
    max_order: int
    seed: int
    tracer: Tracer
    interpolate_normals: bool = False
    lobes: bool = True
    rays_per_shard: int = 65536
    rays_per_batch: int = field(default=16384, compare=False)

    def __post_init__(self) -> None:
        wi = self.wi
        if wi.shape != (3,) or not np.isfinite(wi).all() or abs(float(wi @ wi) - 1) > 1e-5 or not wi[2] > 0:
            raise ValueError(
                f"simulate(wi=...) must be a unit vector (3,) above the horizon, away from the surface; got "
                f"{wi.tolist()}. Use torch.nn.functional.normalize; for light from inside a dielectric pass "
                "Refractive(1 / eta)."
            )
        if self.n_surfaces < 1:
            raise ValueError("simulate(surface=...) must hold at least 1 surface; got an empty sequence.")
        if not self.n_surfaces <= self.n_rays <= 2**32:
            raise ValueError(
                f"simulate(n_rays=...) must lie in [{self.n_surfaces}, 2**32], one or more a surface; got "
                f"{self.n_rays}."
            )
        if not 1 <= self.max_order <= 1000:
            raise ValueError(f"simulate(max_order=...) must lie in [1, 1000]; got {self.max_order}. Use 10.")
        if self.seed < 0:
            raise ValueError(f"simulate(seed=...) must be 0 or more; got {self.seed}.")
        for name in ("rays_per_shard", "rays_per_batch"):
            if not 1 <= getattr(self, name) <= 2**24:
                raise ValueError(f"simulate({name}=...) must lie in [1, 2**24]; got {getattr(self, name)}. Use 65536.")

    @property
    def n_surfaces(self) -> int:
        """Independent surfaces."""
        if isinstance(self.surface, GaussianSurfaces):
            return self.surface.count
        return 1 if isinstance(self.surface, Heightfield) else len(self.surface)

    def make_surface(self, index: int) -> Heightfield:
        """The `index`-th surface; a recipe's are made anew from their seeds."""
        if isinstance(self.surface, GaussianSurfaces):
            return self.surface.surface(surface_seed(self.seed, index))
        return self.surface if isinstance(self.surface, Heightfield) else self.surface[index]

    @cached_property
    def shards(self) -> tuple[Shard, ...]:
        """All shards, surface by surface; rays are shared out evenly among the surfaces."""
        out: list[Shard] = []
        for s in range(self.n_surfaces):
            rays = self.n_rays // self.n_surfaces + (s < self.n_rays % self.n_surfaces)
            parts = math.ceil(rays / self.rays_per_shard)
            if self.n_surfaces == 1:
                parts = max(parts, min(GROUPS_OF_ONE_SURFACE, rays))
            for part in range(parts):
                share = rays // parts + (part < rays % parts)
                out.append(Shard(len(out), s, part, share))
        return tuple(out)

    @property
    def n_groups(self) -> int:
        """Groups that standard errors are taken over: the surfaces, or parts of the only one."""
        return self.n_surfaces if self.n_surfaces > 1 else min(GROUPS_OF_ONE_SURFACE, len(self.shards))

    def group(self, shard: Shard) -> int:
        """Group of a shard."""
        return shard.surface if self.n_surfaces > 1 else shard.part % self.n_groups

    def nothing(self) -> Partial:
        """The empty result of all shards."""
        return Partial.zeros(self.n_groups, self.n_surfaces, self.max_order, self.material.channels, self.lobes)

    def configuration(self) -> dict[str, Any]:
        """What fixes the result, JSON-serialisable; two runs with equal configurations have equal bits."""
        if isinstance(self.surface, GaussianSurfaces):
            surface: dict[str, Any] = {"kind": "GaussianSurfaces"} | vars(self.surface)
        else:
            fields = [self.surface] if isinstance(self.surface, Heightfield) else list(self.surface)
            surface = {"kind": "Heightfield", "count": len(fields), "sha256": [_fingerprint(f) for f in fields]}
        return {
            "format": FORMAT,
            "surface": surface,
            "material": self.material.describe(),
            "tracer": self.tracer.describe(),
            "wi": [float(v) for v in self.wi],
            "n_rays": self.n_rays,
            "max_order": self.max_order,
            "seed": self.seed,
            "interpolate_normals": self.interpolate_normals,
            "lobes": self.lobes,
            "rays_per_shard": self.rays_per_shard,
        }

    def run_shard(self, shard: Shard, grid: Grid, caster: Caster, measured: np.ndarray) -> Partial:
        """Trace one shard; depends on nothing but the plan and the shard's number."""
        from torchms.microsurface.simulation.facets import launch, remaining, settle

        material, channels = self.material, self.material.channels
        found = Partial.zeros(1, 1, self.max_order, channels, self.lobes)
        found.measured[0] = measured
        paths = Paths.empty(min(self.rays_per_batch, shard.rays), channels, material.weighted)
        p, trace, segments = paths, TraceCount(), 0
        key = shard_key(self.seed, shard.surface, shard.part)
        place = (p.x, p.y, p.z, p.d, p.tri, p.side, p.ray)
        nx, ny = grid.heights.shape
        for first in range(0, shard.rays, self.rays_per_batch):
            p.n = min(self.rays_per_batch, shard.rays - first)
            p.weight[: p.n] = 1
            launch(first, shard.rays, key, self.wi, nx, ny, grid.launch_height, *place, p.n)
            for events in range(self.max_order + 1):
                if events:
                    material.scatter(p, grid, events, key, self.interpolate_normals)
                segments += p.n
                trace.add(caster.cast(p))
                energies = (found.reflected[0], found.transmitted[0], found.leaked[0], found.lobes[0])
                p.n = settle(events, material.factor(events), material.weighted, p.weight, *energies, *place, p.n)
                if not p.n:
                    break
            remaining(material.factor(self.max_order), material.weighted, p.weight, found.rest[0], p.n)
        found.counts[0] = (shard.rays, segments, trace.casts, trace.repeats, trace.leaked)
        return found

    def tally(self, total: Partial) -> Tally:
        """The result of all shards; `info` holds the configuration and the diagnostics, not the speed."""
        rays = total.counts[:, 0].astype(np.float64)
        reflected, transmitted = _mean(total.reflected, rays), _mean(total.transmitted, rays)
        out = _mean(total.reflected.sum(1) + total.transmitted.sum(1), rays)
        rest, leaked = _mean(total.rest, rays), _mean(total.leaked, rays)
        lost, absorbed = _mean(total.rest + total.leaked, rays), 1 - out[0] - rest[0] - leaked[0]
        segments = int(total.counts[:, COUNTERS.index("segments")].sum())
        lobes = None
        if self.lobes:
            mean, stderr = _mean(total.lobes, rays)
            per_sr = mean.shape[1] * mean.shape[2] / (4 * math.pi)
            lobes = Lobes(torch.from_numpy(mean * per_sr), torch.from_numpy(stderr * per_sr))
        variance = total.measured[:, :2]
        info = {
            "configuration": self.configuration(),
            "lost": lost[0].tolist(),
            "lost_stderr": lost[1].tolist(),
            "leaked": leaked[0].tolist(),
            # Rounding of 1 − Σ is not absorption.
            "absorbed": np.where(np.abs(absorbed) < 1e-8, 0.0, absorbed).tolist(),
            "leak_rate": int(total.counts[:, COUNTERS.index("leaked_segments")].sum()) / max(segments, 1),
            "stderr_over": f"{self.n_groups} surfaces" if self.n_surfaces > 1 else f"{self.n_groups} groups of rays",
            "slopes": {
                "variance": variance.mean(0).tolist(),
                "alpha": np.sqrt(2 * variance.mean(0)).tolist(),
                "distance_to_beckmann": total.measured[:, 2:].mean(0).tolist(),
                "variance_per_surface": variance.tolist(),
            },
        } | {name: int(total.counts[:, i].sum()) for i, name in enumerate(COUNTERS)}
        names = ("reflected", "transmitted", "total", "rest")
        pairs = dict(zip(names, (reflected, transmitted, out, rest), strict=True))
        energies = {name: torch.from_numpy(mean) for name, (mean, _) in pairs.items()}
        errors = {f"{name}_stderr": torch.from_numpy(stderr) for name, (_, stderr) in pairs.items()}
        return Tally(
            **energies,
            **errors,
            n=int(rays.sum()),
            lobes=lobes,
            info=info,
        )


def measure(surface: Heightfield) -> np.ndarray:
    """The numbers of `MEASURED` for one surface."""
    report = surface.report()
    return np.array([*report["slope_variance"], *report["slope_distance"]])


def run_surface(
    plan: Plan,
    shards: Sequence[Shard],
    run: Callable[[Callable[[Shard], Partial], Sequence[Shard]], None],
) -> None:
    """Build the surface of `shards` (all of the same one) and hand `run` the function that traces one of them."""
    surface = plan.make_surface(shards[0].surface)
    measured = measure(surface)
    grid = Grid.of(surface)
    caster = plan.tracer.bind(grid)
    # A few rays first: Numba compiles or loads its kernels here, and no speed is measured on that.
    plan.run_shard(Shard(-1, shards[0].surface, 0, 8), grid, caster.fork(), measured)
    run(lambda shard: plan.run_shard(shard, grid, caster.fork(), measured), shards)


def _mean(energy: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over all rays and its standard error from the spread of the groups (infinite if there is one)."""
    from torchms.microsurface.simulation.facets import UNIT

    groups, total = len(rays), rays.sum()
    shape = (groups,) + (1,) * (energy.ndim - 1)
    mean = energy.sum(0).astype(np.float64) / (UNIT * total)
    if groups < 2:
        return mean, np.full_like(mean, math.inf)
    share = (rays / total).reshape(shape)
    difference = energy / (UNIT * rays.reshape(shape)) - mean
    return mean, np.sqrt((share**2 * difference**2).sum(0) * groups / (groups - 1))


def _fingerprint(surface: Heightfield) -> str:
    digest = hashlib.sha256(np.array([*surface.shape, *surface.spacing]).tobytes())
    digest.update(np.ascontiguousarray(surface.heights, dtype=np.float64).tobytes())
    return digest.hexdigest()[:16]
