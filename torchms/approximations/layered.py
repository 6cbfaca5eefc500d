"""A rough, reflecting layer on a base, all bounces: learned lobes, made white, and the base coupled to what they let through.

With E(w) the share that the layer returns, T = 1 − E, F0 its reflectance and ρ the albedo of the base, the base adds

    f = A s(wi) k(wi, wo) s(wo),   ∫ s(wi) k s(wo) cos θ_o dwo = T(wi) / (1 − F0),

A the share of 1 − F0 that reaches the base, k = Σ_k ρ'^k k_k the lobe of the base, ρ' = ρ (1 − E_avg) / (1 − ρ E_avg): what
comes up again is thrown back with E_avg, and meets ρ once more. White (ρ = 1, A = 1 − F0) returns all light.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from functools import cache

import torch
from torch import Tensor, nn

from torchms.approximations.diffuse_lobes import DiffuseLobes, powers
from torchms.approximations.distilled import packaged
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.layered_table import LEVELS, Layer, LayeredTable, level_polynomials, seen_alpha
from torchms.approximations.metal_features import above
from torchms.approximations.metal_lobes import MetalLobes
from torchms.approximations.metal_sampling import MetalProposal
from torchms.approximations.metal_walk import metal_walk
from torchms.distributions.base import EllipticDistribution
from torchms.estimators.base import Exit, Scattering
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.maths.numerics import safe_div
from torchms.parameters.exchange import with_parameters
from torchms.paths.mirror import Mirror
from torchms.paths.vertex import Vertex
from torchms.sampling.proposals import Proposal


def lobes_file(facet: str) -> Distillate:
    """The learned lobes of GGX facets that come with torchms, read once."""
    return packaged("GGX", facet)


_read_table = cache(LayeredTable.packaged)


def layered_table() -> LayeredTable:
    """The table that comes with torchms, which is read once; the module is the caller's."""
    table = _read_table()
    return with_parameters(table, dict(table.named_buffers()))


def fingerprint() -> str:
    """What tells the lobes in the package from others."""
    found = hashlib.sha256()
    for facet in ("metal", "diffuse"):
        file = lobes_file(facet)
        networks = [(file.layers, file.skip), *([] if file.each is None else [file.each])]
        for layers, skip in networks:
            for x in (*(x for layer in layers for x in layer), skip):
                found.update(x.contiguous().numpy().tobytes())
    return found.hexdigest()[:16]


def learned(distribution: EllipticDistribution, facet: str) -> EllipticDistribution:
    """`distribution`, or the smoothest one of which there are lobes where it is smoother."""
    low, high = lobes_file(facet).alpha
    names = ("alpha",) if distribution.alpha_y is None else ("alpha", "alpha_y")
    return with_parameters(distribution, {name: getattr(distribution, name).clamp(low, high) for name in names})


class Whitened(Scattering):
    """All bounces between the facets of a GGX layer, whose white furnace is white: `Distilled` but for a factor.

    Lobes of α < 0.03 are those of 0.03, scaled to what one bounce loses. Orders as in `Distilled`.
    """

    sources = ("Wang2022", "Cui2023", "KullaConty2017")

    max_order = 4
    is_unbiased = False
    is_reciprocal = True

    def __init__(self) -> None:
        super().__init__()
        self.lobes = MetalLobes(lobes_file("metal"))
        self.table = layered_table()
        self.single = SingleBounce()

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + vertex.n_uniforms + MetalProposal.n_uniforms

    def is_deterministic(self, vertex: Vertex) -> bool:
        return True

    def check(self, vertex: Vertex) -> None:
        """What builds it gives it the right vertex."""

    def proposal(self, vertex: Vertex) -> Proposal:
        return MetalProposal(_elliptic(vertex))

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        assert isinstance(vertex, Mirror)
        return [*self.single.evaluate(vertex, wi, wo, u), *self._rest(vertex, wi, wo)]

    def _rest(self, vertex: Mirror, wi: Vec3, wo: Vec3) -> list[Tensor]:
        given = _elliptic(vertex)
        level_i, level_o = (self.table.level(seen_alpha(given, w), w) for w in (above(wi), above(wo)))
        white = torch.exp(level_i + level_o)
        distribution = learned(_elliptic(vertex), "metal")
        return [white * value for value in self.lobes.orders(distribution, vertex.fresnel, wi, wo)]

    def layers(self, distribution: EllipticDistribution, wi: Vec3, wo: Vec3, rough: bool) -> tuple[Layer, Layer]:
        """The layer as it is seen from either direction: the same one, if it is round."""
        first = self.table.layer(seen_alpha(distribution, wi), rough)
        if distribution.alpha_y is None:
            return first, first
        return first, self.table.layer(seen_alpha(distribution, wo), rough)

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        assert isinstance(vertex, Mirror)
        distribution = learned(_elliptic(vertex), "metal")

        def rest(d: Vec3) -> tuple[list[Tensor], list[Tensor]]:
            return self._rest(vertex, wi, d), self.lobes.rest(distribution, above(wi), d).lobes

        return metal_walk(vertex, self.single, MetalProposal(_elliptic(vertex)), rest, wi, u)


class DiffuseBase(nn.Module):
    """What is below the layer: Lambert's, or `rough` diffuse facets of the same roughness."""

    def __init__(self, rough: bool) -> None:
        super().__init__()
        self.rough = rough
        self.lobes = DiffuseLobes(lobes_file("diffuse")) if rough else None

    def returned(
        self, distribution: EllipticDistribution, albedo: Tensor, wi: Vec3, wo: Vec3, first: bool = False
    ) -> Tensor:
        """k · cos θ_o [1/sr], (C, N, …), of a base with `albedo` (C, 1, …) that nothing covers; `first`: of one bounce."""
        if self.lobes is None:
            return albedo * (wo.z / math.pi)
        lobes, fall = self.lobes.white(learned(distribution, "diffuse"), wi, wo)
        if first:
            return albedo * lobes[0]
        values = [factor * lobe for factor, lobe in zip(powers(albedo, fall), lobes, strict=True)]
        return sum(values[1:], values[0])

    def covered(
        self,
        layers: tuple[Layer, Layer],
        distribution: EllipticDistribution,
        f0: Tensor,
        albedo: Tensor,
        wi: Vec3,
        wo: Vec3,
    ) -> Tensor:
        """s(wi) k s(wo) cos θ_o [1/sr] below a layer of reflectance `f0`, (C, N, …)."""
        levels = level_polynomials(f0, LEVELS)
        coupling = layers[0].coupling_at(wi, levels) * layers[1].coupling_at(wo, levels)
        through = (1 - f0) * passing(layers, levels)
        return coupling * self.returned(distribution, inner_albedo(albedo, through), wi, wo)

    def reflected(self, layer: Layer, f0: Tensor, albedo: Tensor, wi: Vec3) -> Tensor:
        """∫ s(wi) k s(wo) cos θ_o dwo [1] of Lambert's base, (C, N, …)."""
        levels = level_polynomials(f0, LEVELS)
        through = passing((layer, layer), levels)
        color = inner_albedo(albedo, (1 - f0) * through)
        return color * layer.coupling_at(wi, levels) * torch.sqrt(through.clamp_min(0))


def passing(layers: tuple[Layer, Layer], levels: Tensor) -> Tensor:
    """(1 − E_avg) / (1 − F0), (C, N, …); of an anisotropic layer the mean of how it is seen from both directions."""
    found = []
    for layer in layers[: 1 if layers[0] is layers[1] else 2]:
        own = layer.passing.shape[1:]
        found.append((layer.passing.reshape(LEVELS, *(1,) * (levels.ndim - 1 - len(own)), *own) * levels).sum(0))
    return sum(found[1:], found[0]) / len(found)


def inner_albedo(albedo: Tensor, through: Tensor) -> Tensor:
    """ρ' of a base of this albedo below a layer that lets `through` 1 − E_avg; 1 for 1."""
    return safe_div(albedo * through, 1 - albedo + albedo * through)


def _elliptic(vertex: Vertex) -> EllipticDistribution:
    assert isinstance(vertex.distribution, EllipticDistribution)
    return vertex.distribution
