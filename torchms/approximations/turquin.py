"""The single-bounce lobe scaled up to the lost energy [Turquin2019]."""

from collections.abc import Sequence

from torch import Tensor

from torchms.approximations.compensated import Compensated
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3
from torchms.maths.numerics import smallest
from torchms.paths.vertex import Vertex


class Turquin(Compensated):
    """f_ss · (1 + F0 (1 − E) / E) with E of `wi`: the cheapest, and not reciprocal.

    F0 is the reflectance at normal incidence. In a dielectric both lobes are divided by E = E_r + E_t. Further bounces have the
    shape of the single one. table: an AlbedoTable or the path of one; None takes those of torchms, for GGX and
    Beckmann. Diffuse facets, other distributions and anisotropic glass are refused with a ValueError.
    """

    sources = ("Turquin2019",)

    is_reciprocal = False

    def n_extra(self, vertex: Vertex) -> int:
        return vertex.n_uniforms

    def multiple(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        E = self._energy(vertex, wi)
        return single * (self.energy(vertex).normal_reflectance(wi.z) * ((1 - E) / E))

    def multiple_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        # A facet of its own: independent of the first one, so the product of the expectations is (1 − E) · f_ss / E.
        (again,) = self.single.walk(vertex, wi, [u[0], *u])
        F = self.energy(vertex).normal_reflectance(wi.z)
        weight = F * again.weight * (again.escapes / self._energy(vertex, wi))
        return Exit(again.d, weight, escapes, again.transmitted)

    def _energy(self, vertex: Vertex, wi: Vec3) -> Tensor:
        """E of `wi`, kept above zero."""
        w, side, _ = vertex.enter(wi)
        lost = self.energy(vertex).loss(w, side)
        return (1 - lost).clamp_min(smallest(lost.dtype) ** 0.25)
