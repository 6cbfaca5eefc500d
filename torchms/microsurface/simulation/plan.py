"""A simulation as numbered shards with their own seeds: what to run, and in which pieces."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch

from torchms.microsurface.rays.tracer import EmbreeTracer, Tracer
from torchms.microsurface.simulation.materials import FacetMaterial
from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.seeds import surface_seed
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.microsurface.surfaces.recipe import GaussianSurfaces

Surfaces = Heightfield | Sequence[Heightfield] | GaussianSurfaces
Incidence = torch.Tensor | np.ndarray | Sequence[float | int]

# Raise when a change of the code changes the numbers: checkpoints of another format are refused.
FORMAT = 1
# A single surface has no spread over surfaces; its rays are dealt into this many groups instead.
GROUPS_OF_ONE_SURFACE = 16


@dataclass(frozen=True)
class Shard:
    """A piece of the work: `rays` rays on surface `surface`, the `part`-th shard of that surface."""

    number: int
    surface: int
    part: int
    rays: int


@dataclass(frozen=True)
class Plan:
    """Everything that fixes the result of a simulation, and the shards it is cut into.

    surface: several surfaces (or a recipe for several) give standard errors from their spread; with a single one
    they come from groups of rays and do not say how far that surface stands for others.
    material: what a facet does to light.
    wi: unit vector away from the surface, above the horizon; rays start above the highest point, everywhere alike.
    n_rays: in all, shared among the surfaces. max_order: facet events that are told apart.
    tracer: `EmbreeTracer()`; `GridTracer()` needs no Embree.
    interpolate_normals: scatter about normals interpolated between the vertices instead of the facets' own.
    lobes: whether directions are counted, too. rays_per_batch: does not change the result.
    """

    surface: Surfaces
    material: FacetMaterial
    wi: Incidence
    n_rays: int | float
    max_order: int = 16
    seed: int = 0
    tracer: Tracer = field(default_factory=EmbreeTracer)
    interpolate_normals: bool = False
    lobes: bool = True
    rays_per_shard: int = 65536
    rays_per_batch: int = field(default=16384, compare=False)

    def __post_init__(self) -> None:
        given = self.wi.detach().cpu().double().numpy() if isinstance(self.wi, torch.Tensor) else self.wi
        wi = np.ascontiguousarray(given, dtype=np.float64)
        object.__setattr__(self, "wi", wi)
        object.__setattr__(self, "n_rays", int(self.n_rays))
        if wi.shape != (3,) or not np.isfinite(wi).all() or abs(float(wi @ wi) - 1) > 1e-5 or not wi[2] > 0:
            raise ValueError(
                f"simulate(wi=...) must be a unit vector (3,) above the horizon, away from the surface; got "
                f"{wi.tolist()}. Use torch.nn.functional.normalize; for light from inside a dielectric pass "
                "DielectricFacets(1 / eta)."
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
        n_rays = int(self.n_rays)
        for s in range(self.n_surfaces):
            rays = n_rays // self.n_surfaces + (s < n_rays % self.n_surfaces)
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


def _fingerprint(surface: Heightfield) -> str:
    digest = hashlib.sha256(np.array([*surface.shape, *surface.spacing]).tobytes())
    digest.update(np.ascontiguousarray(surface.heights, dtype=np.float64).tobytes())
    return digest.hexdigest()[:16]
