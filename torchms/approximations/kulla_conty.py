"""A diffuse lobe for the lost energy [KullaConty2017]."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.approximations.compensated import Compensated
from torchms.approximations.mean_fresnel import mean_fresnel
from torchms.estimators.base import Exit
from torchms.maths.frame import Vec3, scaled
from torchms.paths.mirror import Mirror
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Vertex
from torchms.sampling.warps import cosine_hemisphere


class KullaConty(Compensated):
    """One bounce plus F_ms (1 − E(i)) (1 − E(o)) / (π (1 − E_avg)): closed, reciprocal, without noise.

    F_ms is that of [Hill2018]. Anisotropic roughness has a table of its own, not a mean α. In a dielectric
    (α_x = α_y, eta in [1/3, 3]) the lost light of either side feeds lobes on both, in shares that keep energy and
    reciprocity. A white furnace is white to 1e-3, for glass to what its table allows (see `AlbedoTable`); the shape of the
    rest, and what coloured metals absorb on the way, are guesses: `benchmarks/accuracy_lobes.py` says how good they are.
    table: an AlbedoTable or the path of one; None takes those of torchms, for GGX and Beckmann. Diffuse facets, other
    distributions and anisotropic glass are refused with a ValueError.
    """

    is_reciprocal = True

    def n_extra(self, vertex: Vertex) -> int:
        return 3 if vertex.transmits else 2

    def rest(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        if isinstance(vertex, Refractive):
            return self._glass(vertex, wi, wo)[None]
        assert isinstance(vertex, Mirror)
        table, distribution = self.table(vertex), vertex.distribution
        # [Tokuyoshi2023] supplement Eq. 1, times cos θ_o.
        lobe = table.loss(distribution, wi) * table.loss(distribution, wo) / table.mean_loss(distribution)
        return saturation(vertex, table.mean_loss(distribution), wi.z) * (lobe * wo.z / math.pi)

    def rest_exit(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor], escapes: Tensor) -> Exit:
        d = cosine_hemisphere(u[0], u[1])
        table, distribution = self.table(vertex), vertex.distribution
        if isinstance(vertex, Refractive):
            _, side, ours = vertex.enter(wi)
            assert side is not None
            crosses = u[2] < self._crossing(vertex, side)
            there = torch.where(crosses, -side, side)
            lost = table.glass_loss(distribution, d, vertex.eta, there)
            weight = lost / table.glass_mean_loss(distribution, vertex.eta, there)
            return Exit(scaled(d, there), torch.where(ours, weight, 0.0)[None], escapes, crosses)
        assert isinstance(vertex, Mirror)
        mean = table.mean_loss(distribution)
        weight = saturation(vertex, mean, wi.z) * (table.loss(distribution, d) / mean)
        return Exit(d, torch.where(wi.z > 0, weight, 0.0), escapes, torch.zeros_like(d.z, dtype=torch.bool))

    def _glass(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor:
        w, side, _ = vertex.enter(wi)
        d, there, _ = vertex.enter(wo)
        assert side is not None and there is not None
        table, distribution = self.table(vertex), vertex.distribution
        eta = vertex.eta
        crosses = self._crossing(vertex, side)
        share = torch.where(side == there, 1 - crosses, crosses)
        lost = table.glass_loss(distribution, w, eta, side) * table.glass_loss(distribution, d, eta, there)
        return share * lost / table.glass_mean_loss(distribution, eta, there) * (d.z / math.pi)

    def _crossing(self, vertex: Refractive, side: Tensor) -> Tensor:
        """Share of the lost light from `side` that leaves on the other side.

        With L the mean loss and T the mean transmittance of either side, the share is T L' / (T L' + T' L). Energy: what
        does not cross stays. Reciprocity asks that share · L = η² share' · L', and T = η² T' holds for any interface.
        """
        table, distribution = self.table(vertex), vertex.distribution
        here = table.glass_mean_loss(distribution, vertex.eta, side)
        beyond = table.glass_mean_loss(distribution, vertex.eta, -side)
        # T / T' = η²: the value of F_avg itself drops out.
        eta2 = vertex.relative_eta(side) ** 2
        return eta2 * beyond / (eta2 * beyond + here)


def saturation(vertex: Mirror, mean_loss: Tensor, like: Tensor) -> Tensor:
    """F_ms = F_avg² E_avg / (1 − F_avg (1 − E_avg)) [Hill2018]: what is left after two bounces and more, (C, …)."""
    F = mean_fresnel(vertex.fresnel, like)
    return F * F * (1 - mean_loss) / (1 - F * mean_loss)
