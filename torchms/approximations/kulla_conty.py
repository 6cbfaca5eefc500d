"""A diffuse lobe for the lost energy [KullaConty2017]."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.approximations.compensated import Compensated
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3
from torchms.paths.vertex import Vertex
from torchms.sampling.warps import cosine_hemisphere


class KullaConty(Compensated):
    """One bounce plus F_ms (1 − E(i)) (1 − E(o)) / (π (1 − E_avg)): closed, reciprocal, without noise.

    F_ms is that of [Hill2018]. Anisotropic roughness has a table of its own, not a mean α. In a dielectric
    (α_x = α_y, eta in [1/3, 3]) the lost light of either side feeds lobes on both, in shares that keep energy and
    reciprocity. A white furnace is white to 1e-3, for glass to what its table allows (see `AlbedoTable`). The shape of
    what is added, and what coloured metals absorb of it, are guesses: `benchmarks/accuracy_lobes.py` says how good.
    table: an AlbedoTable or the path of one; None takes those of torchms, for GGX and Beckmann. Diffuse facets, other
    distributions and anisotropic glass are refused with a ValueError.
    """

    sources = ("KullaConty2017", "Hill2018")

    is_reciprocal = True

    def n_extra(self, vertex: Vertex) -> int:
        return 3 if vertex.transmits else 2

    def multiple(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        energy = self.energy(vertex)
        w, side, _ = vertex.enter(wi)
        d, there, _ = vertex.enter(wo)
        # [Tokuyoshi2023] supplement Eq. 1, times cos θ_o.
        lobe = energy.loss(w, side) * energy.loss(d, there) / energy.mean_loss(there)
        share = energy.share(side, there)
        lobe = lobe if share is None else share * lobe
        return energy.kept(wi.z) * (lobe * d.z / math.pi)

    def multiple_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        energy = self.energy(vertex)
        d = cosine_hemisphere(u[0], u[1])
        _, side, served = vertex.enter(wi)
        there, transmitted = energy.exit_side(side, d.z, u[2:])
        weight = energy.kept(wi.z) * (energy.loss(d, there) / energy.mean_loss(there))
        return Exit(vertex.world(d, there), torch.where(served, weight, 0.0), escapes, transmitted)
