"""All bounces at the price of a look-up: what the exact estimators give in expectation, learned once."""

from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from torchms.approximations import distilled_file as files
from torchms.approximations.metal_features import FEATURES, above
from torchms.approximations.metal_lobes import OUTPUTS, MetalLobes
from torchms.approximations.metal_sampling import MetalProposal
from torchms.distributions.base import EllipticDistribution
from torchms.estimators.base import Exit, Scattering
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon
from torchms.parameters.declared import first_bad
from torchms.paths.mirror import Mirror
from torchms.paths.vertex import Vertex
from torchms.sampling.proposals import Proposal

KNOWN = ("GGX", "Beckmann")
REMEDY = "Use Bidirectional(Invariance()), which is exact, or KullaConty()."


class Distilled(Scattering):
    """All bounces off rough metal without noise and without random numbers, learned from `Bidirectional(Invariance())`.

    Orders: index 0 is one bounce, exact; 1 and 2 are two and three bounces; 3 is all from four on together. Reciprocal,
    positive and symmetric by construction; with F = 1 the energies add up to 1, see the certificate in `certificates`.
    Any Fresnel term: each order meets facets at one effective cosine, which is exact to first order in the variation of F.
    table: the path of a file that `python -m torchms.approximations.distil` wrote; None takes those of torchms, for GGX and
    Beckmann with α_x and α_y in [0.03, 1]. Other distributions, roughnesses outside that range, glass and diffuse facets
    are refused with a ValueError.
    """

    sources = ("Wang2022", "Cui2023")

    max_order = 4
    is_unbiased = False
    is_reciprocal = True

    def __init__(self, table: str | Path | None = None) -> None:
        super().__init__()
        if table is None:
            found = [packaged(name) for name in KNOWN]
        elif isinstance(table, str | Path):
            found = [files.read(table, "metal", FEATURES, OUTPUTS)]
        else:
            raise TypeError(
                "Distilled(table=...) must be the path of a file of distilled lobes, or None for those that come with "
                f"torchms; got {table!r}."
            )
        self.lobes = nn.ModuleDict({each.distribution: MetalLobes(each.layers, each.skip) for each in found})
        self.ranges = {each.distribution: each.alpha for each in found}
        self.certificates: dict[str, dict[str, Any]] = {each.distribution: each.certificate for each in found}
        self.single = SingleBounce()

    def n_uniforms(self, vertex: Vertex) -> int:
        return 1 + vertex.n_uniforms + MetalProposal.n_uniforms

    def is_deterministic(self, vertex: Vertex) -> bool:
        return True

    def check(self, vertex: Vertex) -> None:
        kind = type(vertex.distribution).__name__
        if not isinstance(vertex, Mirror):
            raise ValueError(f"Distilled holds lobes of metal only; got a facet that is no mirror. {REMEDY}")
        if kind not in self.lobes or not isinstance(vertex.distribution, EllipticDistribution):
            raise ValueError(
                f"Distilled(table=...) holds lobes of {', '.join(self.lobes)}; got the distribution {kind}. {REMEDY}"
            )
        low, high = self.ranges[kind]
        for name, alpha in zip(("alpha", "alpha_y"), vertex.distribution.alphas, strict=True):
            value = alpha.detach()
            if value.is_meta or isinstance(value, torch._subclasses.FakeTensor):
                continue
            # The range holds for numbers of any precision: 0.03 in float32 is a little less than in float64.
            bad = (value < low * (1 - 1e-6)) | (value > high * (1 + 1e-6))
            if bool(bad.any()):
                raise ValueError(
                    f"Distilled: {kind}({name}=...) must lie in [{low:g}, {high:g}], for which its lobes were distilled; "
                    f"got {first_bad(bad, value)}. {REMEDY} For a range of your own run "
                    "python -m torchms.approximations.distil and give its file as Distilled(table)."
                )

    def proposal(self, vertex: Vertex) -> Proposal:
        return MetalProposal(_elliptic(vertex))

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        assert isinstance(vertex, Mirror)
        return [
            *self.single.evaluate(vertex, wi, wo, u),
            *self._lobes(vertex).orders(_elliptic(vertex), vertex.fresnel, wi, wo),
        ]

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        assert isinstance(vertex, Mirror)
        # How often light leaves with the rest is chosen beforehand, close to how often it does: then the weights are right
        # whatever the choice.
        proposal = MetalProposal(_elliptic(vertex))
        again = proposal.rest_share(wi)
        (first,) = self.single.walk(vertex, wi, u)
        yield Exit(
            first.d,
            first.weight * (first.escapes / (1 - again)),
            (1 - again).expand_as(first.escapes),
            first.transmitted,
        )
        d = proposal.sample_rest(wi, u[1 + vertex.n_uniforms :])
        d = Vec3(d.x, d.y, d.z.clamp_min(horizon(d.z.dtype)))
        density = proposal.rest_density(above(wi), d)
        values = self._lobes(vertex).orders(_elliptic(vertex), vertex.fresnel, wi, d)
        white = self._lobes(vertex).rest(_elliptic(vertex), above(wi), d).lobes
        total = sum(white[1:], white[0])
        for value, lobe in zip(values, white, strict=True):
            escapes = again * (lobe / total)
            yield Exit(d, value / (density * escapes), escapes, torch.zeros_like(first.transmitted))

    def _lobes(self, vertex: Vertex) -> MetalLobes:
        found = self.lobes[type(vertex.distribution).__name__]
        assert isinstance(found, MetalLobes)
        return found

    def extra_repr(self) -> str:
        return ", ".join(f"{name} in [{low:g}, {high:g}]" for name, (low, high) in self.ranges.items())


def packaged(distribution: str) -> files.Distillate:
    """The lobes that come with torchms."""
    name = f"distilled_{distribution.lower()}_metal.npz"
    with resources.as_file(resources.files("torchms.approximations") / name) as path:
        return files.read(path, "metal", FEATURES, OUTPUTS)


def _elliptic(vertex: Vertex) -> EllipticDistribution:
    assert isinstance(vertex.distribution, EllipticDistribution)
    return vertex.distribution
