"""What the two compensations share: a table of energies says how much bounces again."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path

from torch import Tensor, nn

from torchms.approximations.albedo_table import KNOWN, AlbedoTable
from torchms.approximations.facet_energy import KINDS, FacetEnergy
from torchms.approximations.first_and_rest import FirstAndRest
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3
from torchms.paths.vertex import Vertex


class Compensated(FirstAndRest):
    """Order 1 is the single bounce, order 2 has the energy of all further ones, from a table; abstract."""

    facets = tuple(KINDS)

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

    def energy(self, vertex: Vertex) -> FacetEnergy:
        """The energies of this vertex, from the table of its distribution."""
        table = self.tables[type(vertex.distribution).__name__]
        assert isinstance(table, AlbedoTable)
        return KINDS[type(vertex)](vertex, table)

    def check(self, vertex: Vertex) -> None:
        name, kind = type(self).__name__, type(vertex.distribution).__name__
        if type(vertex) not in self.facets:
            raise ValueError(
                f"{name} has no formula for {type(vertex).__name__.lower()} facets: it compensates what mirrors and glass "
                "lose. Use Unidirectional(Invariance()) or Bidirectional(Invariance())."
            )
        if kind not in self.tables:
            raise ValueError(
                f"{name}(table=...) holds tables of {', '.join(self.tables)}; got the distribution {kind}. "
                "Use one of those, or a scattering that needs no table, such as Bidirectional(Invariance())."
            )
        KINDS[type(vertex)].check(vertex, name)

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        (first,) = self.single.walk(vertex, wi, u)
        yield first
        # Light that does not leave now leaves after more bounces; on average that is 1 − E(wi) of it.
        yield self.multiple_exit(vertex, wi, u[1 + vertex.n_uniforms :], 1 - first.escapes)

    @abstractmethod
    def multiple_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        """How light leaves after more than one bounce, with probability `escapes`."""
