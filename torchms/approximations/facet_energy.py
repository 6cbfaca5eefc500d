"""What a compensation knows of one kind of facet: the energies that a single bounce loses, and where they may go.

A kind of vertex is one class here and one line in `KINDS`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import torch
from torch import Tensor

from torchms.approximations.albedo_table import AlbedoTable
from torchms.approximations.coordinates import ETA
from torchms.approximations.mean_fresnel import mean_fresnel
from torchms.fresnel.dielectric import Dielectric
from torchms.maths.frame import Vec3
from torchms.maths.numerics import has_values
from torchms.paths.mirror import Mirror
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Side, Vertex


@dataclass(frozen=True)
class FacetEnergy(ABC, Generic[Side]):
    """The energies of a `vertex` of one kind, from a `table` of its distribution."""

    vertex: Vertex[Side]
    table: AlbedoTable

    @classmethod
    @abstractmethod
    def check(cls, vertex: Vertex, owner: str) -> None:
        """Raise ValueError, with the remedy, if the table does not hold for `vertex`."""

    @abstractmethod
    def loss(self, w: Vec3, side: Side) -> Tensor:
        """1 − E(w) of one bounce without absorption; `w` in the frame of `side`."""

    @abstractmethod
    def mean_loss(self, side: Side) -> Tensor:
        """1 − E_avg: its mean over the hemisphere on `side`."""

    @abstractmethod
    def share(self, side: Side, there: Side) -> Tensor | None:
        """Share of the light lost on `side` that leaves on the side `there`; None where all of it does."""

    @abstractmethod
    def exit_side(self, side: Side, like: Tensor, numbers: Sequence[Tensor]) -> tuple[Side, Tensor]:
        """A side drawn by these shares, and whether it is the other one, (…) with the axes of `like`."""

    @abstractmethod
    def kept(self, like: Tensor) -> Tensor:
        """F_ms: what absorption leaves of the light that a bounce lost, (C, …) with the axes of `like`."""

    @abstractmethod
    def normal_reflectance(self, like: Tensor) -> Tensor:
        """What a bounce at normal incidence leaves, (C, …) with the axes of `like`."""


@dataclass(frozen=True)
class MirrorEnergy(FacetEnergy[None]):
    """Facets that reflect, and absorb what their Fresnel term says."""

    vertex: Mirror

    @classmethod
    def check(cls, vertex: Vertex, owner: str) -> None:
        """Any mirror will do."""

    def loss(self, w: Vec3, side: None) -> Tensor:
        return self.table.loss(self.vertex.distribution, w)

    def mean_loss(self, side: None) -> Tensor:
        return self.table.mean_loss(self.vertex.distribution)

    def share(self, side: None, there: None) -> None:
        return None

    def exit_side(self, side: None, like: Tensor, numbers: Sequence[Tensor]) -> tuple[None, Tensor]:
        return None, torch.zeros_like(like, dtype=torch.bool)

    def kept(self, like: Tensor) -> Tensor:
        """F_avg² E_avg / (1 − F_avg (1 − E_avg)) [Hill2018]: what is left after two bounces and more."""
        F, mean_loss = mean_fresnel(self.vertex.fresnel, like), self.mean_loss(None)
        return F * F * (1 - mean_loss) / (1 - F * mean_loss)

    def normal_reflectance(self, like: Tensor) -> Tensor:
        return self.vertex.fresnel.reflectance(torch.ones_like(like))


@dataclass(frozen=True)
class GlassEnergy(FacetEnergy[Tensor]):
    """Facets that reflect or refract, and absorb nothing."""

    vertex: Refractive

    @classmethod
    def check(cls, vertex: Vertex, owner: str) -> None:
        assert isinstance(vertex, Refractive)
        if not isinstance(vertex.fresnel, Dielectric):
            raise ValueError(
                f"{owner}: the table of glass is for Dielectric(eta); got {type(vertex.fresnel).__name__}. Use HeightWalk()."
            )
        if getattr(vertex.distribution, "alpha_y", None) is not None:
            raise ValueError(
                f"{owner} serves a dielectric with alpha_x = alpha_y only: its table has no anisotropic glass, and a mean "
                "alpha would break the energy balance. Leave alpha_y out, or use HeightWalk()."
            )
        eta = vertex.eta.detach()
        if has_values(eta) and bool(((eta > ETA) | (eta < 1 / ETA)).any()):
            raise ValueError(
                f"{owner}: the table of dielectrics is for eta in [1/{ETA:g}, {ETA:g}]; got "
                f"{float(eta.min()):g} to {float(eta.max()):g}. Use HeightWalk()."
            )

    def loss(self, w: Vec3, side: Tensor) -> Tensor:
        return self.table.glass_loss(self.vertex.distribution, w, self.vertex.eta, side)

    def mean_loss(self, side: Tensor) -> Tensor:
        return self.table.glass_mean_loss(self.vertex.distribution, self.vertex.eta, side)

    def share(self, side: Tensor, there: Tensor) -> Tensor:
        crosses = self._crossing(side)
        return torch.where(side == there, 1 - crosses, crosses)

    def exit_side(self, side: Tensor, like: Tensor, numbers: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        crosses = numbers[0] < self._crossing(side)
        return torch.where(crosses, -side, side), crosses

    def _crossing(self, side: Tensor) -> Tensor:
        """The share that leaves on the other side.

        With L the mean loss and T the mean transmittance of either side, it is T L' / (T L' + T' L).

        Energy: what does not cross stays. Reciprocity asks that share · L = η² share' · L', and T = η² T' holds for any
        interface.
        """
        here, beyond = self.mean_loss(side), self.mean_loss(-side)
        # T / T' = η²: the value of F_avg itself drops out.
        eta2 = self.vertex.fresnel.relative_eta(side) ** 2
        return eta2 * beyond / (eta2 * beyond + here)

    def kept(self, like: Tensor) -> Tensor:
        return torch.ones_like(like)[None]

    def normal_reflectance(self, like: Tensor) -> Tensor:
        return torch.ones_like(like)[None]


KINDS: dict[type[Vertex], type[FacetEnergy]] = {Mirror: MirrorEnergy, Refractive: GlassEnergy}
"""Vertex → its energies."""
