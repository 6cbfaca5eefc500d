"""The single-bounce lobe scaled up to the lost energy [Turquin2019]."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.approximations.compensated import Compensated
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3
from torchms.maths.numerics import smallest
from torchms.paths.mirror import Mirror
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Vertex


class Turquin(Compensated):
    """f_ss · (1 + F0 (1 − E) / E) with E of `wi`: the cheapest, and not reciprocal.

    F0 is the reflectance at normal incidence. In a dielectric both lobes are divided by E = E_r + E_t. The rest has the
    shape of the single bounce. table: an AlbedoTable or the path of one; None takes those of torchms, for GGX and
    Beckmann. Diffuse facets, other distributions and anisotropic glass are refused with a ValueError.
    """

    is_reciprocal = False

    def n_extra(self, vertex: Vertex) -> int:
        return vertex.n_uniforms

    def rest(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        E = self._energy(vertex, wi)
        return single * (self._normal_reflectance(vertex, wi) * ((1 - E) / E))

    def rest_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        # A facet of its own: independent of the first one, so the product of the expectations is (1 − E) · f_ss / E.
        (again,) = self.single.walk(vertex, wi, [u[0], *u])
        weight = self._normal_reflectance(vertex, wi) * again.weight * (again.escapes / self._energy(vertex, wi))
        return Exit(again.d, weight, escapes, again.transmitted)

    def _energy(self, vertex: Vertex, wi: Vec3) -> Tensor:
        w, side, _ = vertex.enter(wi)
        table = self.table(vertex)
        if side is None:
            lost = table.loss(vertex.distribution, w)
        else:
            assert isinstance(vertex, Refractive)
            lost = table.glass_loss(vertex.distribution, w, vertex.eta, side)
        return (1 - lost).clamp_min(smallest(lost.dtype) ** 0.25)

    def _normal_reflectance(self, vertex: Vertex, wi: Vec3) -> Tensor:
        if isinstance(vertex, Refractive):
            return torch.ones_like(wi.z)[None]
        assert isinstance(vertex, Mirror)
        return vertex.fresnel.reflectance(torch.ones_like(wi.z))
