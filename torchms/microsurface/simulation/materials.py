"""What one facet does to the light that meets it; goes into the `material` slot of `simulate`."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.microsurface.rays.grid import Grid, Paths


class FacetMaterial(ABC):
    """A facet's scattering. Light that the facet absorbs goes off the paths' weight, or off `factor`."""

    @property
    def channels(self) -> int:
        """C, the number of colour channels."""
        return 1

    @property
    def weighted(self) -> bool:
        """Whether paths carry a weight of their own (absorption that depends on the angle)."""
        return False

    def factor(self, events: int) -> np.ndarray:
        """(C,) share of the energy that is left after `events` scattering events, beyond the paths' own weights."""
        return np.ones(self.channels)

    @abstractmethod
    def scatter(self, paths: Paths, grid: Grid, event: int, key: np.ndarray, interpolate: bool) -> None:
        """Replace the directions of the first `paths.n` paths, which sit on their facets, in place.

        event: 1 for the first facet; with `key` and the ray's number it fixes the random numbers.
        interpolate: scatter about normals interpolated between vertices instead of the facet's own.
        """

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Configuration, JSON-serialisable: what may change the result."""


@dataclass(frozen=True)
class MirrorFacets(FacetMaterial):
    """Mirror facets whose reflectance is `fresnel(cos θ)`, (…) → (…, C); None reflects everything (F = 1)."""

    fresnel: Callable[[Tensor], Tensor] | None = None

    def __post_init__(self) -> None:
        if self.fresnel is None:
            return
        F = self._reflectance(np.linspace(0.0, 1.0, 17))
        if F.ndim != 2 or F.shape[0] != 17 or not np.isfinite(F).all() or F.min() < 0 or F.max() > 1 + 1e-6:
            raise ValueError(
                "MirrorFacets(fresnel=...) must map cosines (...) to reflectances (..., C) in [0, 1]; got shape "
                f"{F.shape} with values from {F.min()} to {F.max()} for 17 cosines. Use a module of torchms.fresnel."
            )

    def _reflectance(self, cosine: np.ndarray) -> np.ndarray:
        assert self.fresnel is not None
        with torch.no_grad():
            return self.fresnel(torch.from_numpy(cosine)).to(torch.float64).numpy()

    @property
    def _is_ideal(self) -> bool:
        if self.fresnel is None:
            return True
        from torchms.fresnel import Ideal

        return isinstance(self.fresnel, Ideal)

    @property
    def channels(self) -> int:
        """C of the Fresnel term."""
        return 1 if self.fresnel is None else int(self._reflectance(np.array([1.0])).shape[-1])

    @property
    def weighted(self) -> bool:
        """Whether facets absorb."""
        return not self._is_ideal

    def scatter(self, paths: Paths, grid: Grid, event: int, key: np.ndarray, interpolate: bool) -> None:
        """See `FacetMaterial`."""
        from torchms.microsurface.simulation.facets import scatter_mirror

        p, n = paths, paths.n
        cosine = np.empty(n)
        scatter_mirror(grid.heights, grid.kx, grid.ky, interpolate, p.x, p.y, p.d, p.tri, p.side, cosine, n)
        if self.weighted:
            p.weight[:n] *= self._reflectance(cosine)

    def describe(self) -> dict[str, Any]:
        """The reflectance at five cosines stands for the Fresnel term."""
        if self.fresnel is None:
            return {"material": "Mirror", "fresnel": [[1.0]] * 5}
        return {"material": "Mirror", "fresnel": self._reflectance(np.linspace(0.0, 1.0, 5)).tolist()}


@dataclass(frozen=True)
class DielectricFacets(FacetMaterial):
    """Smooth dielectric facets, η = n_inside / n_outside; light comes from outside (take 1/η for light from inside)."""

    eta: float | int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.eta) and 0.1 <= self.eta <= 10) or self.eta == 1:
            raise ValueError(
                f"DielectricFacets(eta=...) must lie in [0.1, 10] and differ from 1; got {self.eta}. It is n_inside / "
                "n_outside: 1.5 for glass seen from air, 1/1.5 from within."
            )

    def scatter(self, paths: Paths, grid: Grid, event: int, key: np.ndarray, interpolate: bool) -> None:
        """See `FacetMaterial`."""
        from torchms.microsurface.simulation.facets import scatter_dielectric

        p = paths
        scatter_dielectric(
            *(grid.heights, grid.kx, grid.ky, interpolate, float(self.eta), event, key),
            *(p.x, p.y, p.d, p.tri, p.side, p.ray, p.n),
        )

    def describe(self) -> dict[str, Any]:
        """See `FacetMaterial`."""
        return {"material": "Refractive", "eta": float(self.eta)}


@dataclass(frozen=True)
class DiffuseFacets(FacetMaterial):
    """Ideally diffuse facets with `albedo`, a number or one a channel."""

    albedo: float | int | Sequence[float | int] = 1.0

    def __post_init__(self) -> None:
        values = self._values
        if (
            values.ndim != 1
            or values.size == 0
            or not np.isfinite(values).all()
            or values.min() < 0
            or values.max() > 1
        ):
            raise ValueError(
                f"DiffuseFacets(albedo=...) must be one or more numbers in [0, 1]; got {self.albedo}. "
                "A facet cannot reflect more than it receives."
            )

    @property
    def _values(self) -> np.ndarray:
        return np.atleast_1d(np.asarray(self.albedo, dtype=np.float64))

    @property
    def channels(self) -> int:
        """Numbers in `albedo`."""
        return len(self._values)

    def factor(self, events: int) -> np.ndarray:
        """See `FacetMaterial`."""
        return self._values**events

    def scatter(self, paths: Paths, grid: Grid, event: int, key: np.ndarray, interpolate: bool) -> None:
        """See `FacetMaterial`."""
        from torchms.microsurface.simulation.facets import scatter_lambertian

        p = paths
        scatter_lambertian(
            *(grid.heights, grid.kx, grid.ky, interpolate, event, key),
            *(p.x, p.y, p.d, p.tri, p.side, p.ray, p.n),
        )

    def describe(self) -> dict[str, Any]:
        """See `FacetMaterial`."""
        return {"material": "Lambertian", "albedo": self._values.tolist()}
