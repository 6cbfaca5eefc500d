"""What the two compensations share: one bounce, then one more term for everything that bounces again."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from torchms.approximations.albedo_table import KNOWN, AlbedoTable
from torchms.approximations.coordinates import ETA
from torchms.estimators.base import Exit, Scattering
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.maths.numerics import has_values
from torchms.paths.diffuse import Diffuse
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Vertex


class Compensated(Scattering):
    """Order 1 is the single bounce, order 2 stands for all further ones together; abstract.

    The energies come from a table, so values are as deterministic as the single bounce is.
    """

    max_order = 2
    is_unbiased = False

    def __init__(self, table: AlbedoTable | str | Path | None = None) -> None:
        super().__init__()
        if isinstance(table, str | Path):
            table = AlbedoTable.load(table)
        if table is not None and not isinstance(table, AlbedoTable):
            raise TypeError(
                f"{type(self).__name__}(table=...) must be an AlbedoTable, the path of one, or None for those that come "
                f"with torchms; got {table!r}."
            )
        tables = [AlbedoTable.packaged(name) for name in KNOWN] if table is None else [table]
        self.tables = nn.ModuleDict({each.distribution: each for each in tables})
        self.single = SingleBounce()

    def table(self, vertex: Vertex) -> AlbedoTable:
        """The table of this vertex's distribution."""
        found = self.tables[type(vertex.distribution).__name__]
        assert isinstance(found, AlbedoTable)
        return found

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + vertex.n_uniforms + self.n_extra(vertex)

    def is_deterministic(self, vertex: Vertex) -> bool:
        return True

    def check(self, vertex: Vertex) -> None:
        name, kind = type(self).__name__, type(vertex.distribution).__name__
        if isinstance(vertex, Diffuse):
            raise ValueError(
                f"{name} has no formula for diffuse facets: it compensates what mirrors and glass lose. "
                "Use Unidirectional(Invariance()) or Bidirectional(Invariance())."
            )
        if kind not in self.tables:
            raise ValueError(
                f"{name}(table=...) holds tables of {', '.join(self.tables)}; got the distribution {kind}. "
                "Use one of those, or a scattering that needs no table, such as Bidirectional(Invariance())."
            )
        if isinstance(vertex, Refractive):
            self._check_glass(vertex, name)

    def _check_glass(self, vertex: Refractive, name: str) -> None:
        if vertex.distribution.alpha_y is not None:
            raise ValueError(
                f"{name} serves a dielectric with alpha_x = alpha_y only: its table has no anisotropic glass, and a mean "
                "alpha would break the energy balance. Leave alpha_y out, or use HeightWalk()."
            )
        eta = vertex.eta.detach()
        if has_values(eta) and bool(((eta > ETA) | (eta < 1 / ETA)).any()):
            raise ValueError(
                f"{name}: the table of dielectrics is for eta in [1/{ETA:g}, {ETA:g}]; got "
                f"{float(eta.min()):g} to {float(eta.max()):g}. Use HeightWalk()."
            )

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        (single,) = self.single.evaluate(vertex, wi, wo, u)
        valid = (wi.z != 0) & (wo.z != 0) if vertex.transmits else (wi.z > 0) & (wo.z > 0)
        return [single, torch.where(valid, self.rest(vertex, wi, wo, single), 0.0)]

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        (first,) = self.single.walk(vertex, wi, u)
        yield first
        # Light that does not leave now leaves with the rest; on average that is 1 − E(wi) of it.
        yield self.rest_exit(vertex, wi, u[1 + vertex.n_uniforms :], 1 - first.escapes)

    @abstractmethod
    def n_extra(self, vertex: Vertex) -> int:
        """Random numbers of the rest's walk."""

    @abstractmethod
    def rest(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        """f · |cos θ_o| of all further bounces [1/sr], (C, 1, …)."""

    @abstractmethod
    def rest_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        """How light leaves with the rest, with probability `escapes`."""
