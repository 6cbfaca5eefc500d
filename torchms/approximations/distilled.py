"""All bounces at the price of a look-up: what the exact estimators give in expectation, learned once."""

import functools
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from torchms.approximations import distilled_file as files
from torchms.approximations.coordinates import ETA
from torchms.approximations.diffuse_lobes import DiffuseLobes
from torchms.approximations.diffuse_surface_lobes import DiffuseSurfaceLobes
from torchms.approximations.distilled_networks import NETWORKS
from torchms.approximations.glass_lobes import GlassLobes
from torchms.approximations.glass_surface_lobes import GlassSurfaceLobes
from torchms.approximations.metal_features import above
from torchms.approximations.metal_lobes import MetalLobes
from torchms.approximations.metal_sampling import MetalProposal
from torchms.approximations.metal_walk import metal_walk
from torchms.approximations.surface_lobes import SurfaceLobes
from torchms.distributions.base import EllipticDistribution
from torchms.distributions.tabulated import Tabulated
from torchms.estimators.base import Exit, Scattering
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.parameters.declared import first_bad
from torchms.parameters.exchange import class_of
from torchms.paths.diffuse import Diffuse
from torchms.paths.mirror import Mirror
from torchms.paths.refractive import Refractive
from torchms.paths.vertex import Vertex
from torchms.sampling.proposals import Proposal

KNOWN = ("GGX", "Beckmann")
SMITH = ("metal", "diffuse", "reflected", "transmitted")
"""Files that come with torchms for each of them."""
FACETS: dict[type[Vertex], str] = {Mirror: "metal", Diffuse: "diffuse", Refractive: "glass"}
REMEDY = "Use HeightWalk(), which is exact, or KullaConty()."


class Distilled(Scattering):
    """All bounces without noise and without random numbers, learned from the exact estimators.

    Metal: index 0 of the orders is one bounce, exact; 1 and 2 are two and three bounces; 3 is all from four on together.
    Any Fresnel term: from F at four cosines and learned means over the facets of each order; energies of gold, copper, chromium
    and aluminium within 1 %, within 0.3 % for α ≤ 0.5. Not so total reflection (`Dielectric` below 1 as a mirror).
    Diffuse: the same orders, the first one included, with the albedo to the power of each. Glass: index 0 is one bounce,
    exact; 1 is all others together; α_x and α_y may differ, the relative index lies in [1/3, 3].
    Reciprocal (for glass with the squares of the indices), positive and symmetric by construction. Energies are learned.
    Lobes of metal are off by 0.2 % of their root mean square in the median, by at most 1.3 % up to 1.4 rad for the surfaces in
    docs/accuracy.md, 2.7 % for random ones. Energies with F = 1 are off by 0.06 % in the median, 0.3 % at most for round
    surfaces with α ≥ 0.25, 5 % for grazing light on smooth ones, 2 % for α = (1, 0.1), and 12 % at worst, for grazing light on
    Beckmann's (0.03, 1).
    Diffuse lobes are off by 0.1 % in the median, by at most 0.8 % for those surfaces, 3.4 % for random ones; their furnace by
    up to 5e-3 (GGX) and 1e-2 (Beckmann). Glass keeps energy to 0.006 in the median, and only to 0.17 at worst at α = 1; its
    lobes are off by 0.4 to 1.9 % in the median, by several times that for rough glass at grazing light or beside a medium of
    lower index.
    table: the path of a file that `python -m torchms.approximations.distil` wrote, or several of them; None takes those of
    torchms, for GGX and Beckmann with α_x and α_y in [0.03, 1]. Other distributions, roughnesses outside that range, and
    facets of which no file is are refused with a ValueError.
    A file that `torchms distil` wrote of a measured surface holds for `slopes`, the `Tabulated` distribution of its slopes.
    One about glass holds for its index, too.
    surface: "gaussian" takes lobes of ray-traced Gaussian random surfaces in place of those of Smith's theory: metal, diffuse
    facets, and glass whose indices have a ratio in [1.3, 3]; Beckmann with α_x and α_y in [0.1, 1]. See docs/surface_lobes.md.
    """

    sources = ("Wang2022", "Cui2023")

    max_order = 4
    is_unbiased = False
    is_reciprocal = True

    def __init__(self, table: str | Path | Sequence[str | Path] | None = None, *, surface: str | None = None) -> None:
        super().__init__()
        if surface not in (None, "gaussian"):
            raise ValueError(f'Distilled(surface=...) must be "gaussian" or None, Smith\'s theory; got {surface!r}.')
        if surface is not None:
            if table is not None:
                raise ValueError(
                    "Distilled(table=..., surface=...): a file says itself which surfaces it is about. Give one of them."
                )
            found = [packaged("Beckmann", f"{surface}{kind}") for kind in ("", "_diffuse", "_glass")]
        elif table is None:
            found = [packaged(name, facet) for name in KNOWN for facet in SMITH]
        else:
            paths = [table] if isinstance(table, str | Path) else table
            if not isinstance(paths, Sequence) or not paths or not all(isinstance(p, str | Path) for p in paths):
                raise TypeError(
                    "Distilled(table=...) must be the path of a file of distilled lobes, or several of them, or None for "
                    f"those that come with torchms; got {table!r}."
                )
            found = [files.read(path, NETWORKS) for path in paths]
        self.lobes = nn.ModuleDict()
        self.ranges: dict[str, tuple[float, float]] = {}
        self.etas: dict[str, list[tuple[float, float]]] = {}
        self.certificates: dict[str, dict[str, Any]] = {}
        for each in found:
            self._add(each, {(x.distribution, x.facet): x for x in found})
        self.single = SingleBounce()
        self.measured = next((each.slopes for each in found if each.slopes is not None), None)

    def _add(self, each: files.Distillate, all_of_them: dict[tuple[str, str], files.Distillate]) -> None:
        """Lobes of one file; glass is added with the file of what it transmits."""
        self.certificates[f"{each.distribution} {each.facet}"] = each.certificate
        low, high = each.alpha
        if each.facet == "metal":
            key, lobes = f"{each.distribution} metal", MetalLobes(each)
        elif each.facet in ("gaussian", "scan"):
            key, lobes = f"{each.distribution} metal", SurfaceLobes(each)
        elif each.facet in ("gaussian_diffuse", "scan_diffuse"):
            key, lobes = f"{each.distribution} diffuse", DiffuseSurfaceLobes(each)
        elif each.facet in ("gaussian_glass", "scan_glass"):
            key, lobes = f"{each.distribution} glass", GlassSurfaceLobes(each)
        elif each.facet == "diffuse":
            key, lobes = f"{each.distribution} diffuse", DiffuseLobes(each)
        else:
            other = all_of_them.get((each.distribution, "reflected" if each.facet == "transmitted" else "transmitted"))
            if other is None:
                raise ValueError(
                    f"Distilled(table=...): glass needs the files of what it reflects and of what it transmits; there is "
                    f"only that of what is {each.facet}. Give both."
                )
            if each.facet == "reflected":
                return
            key, lobes = f"{each.distribution} glass", GlassLobes(other, each)
            low, high = max(low, other.alpha[0]), min(high, other.alpha[1])
        self.lobes[key], self.ranges[key] = lobes, (low, high)
        self.etas[key] = [each.eta or (1 / ETA, ETA)]
        if each.eta and each.slopes is None:
            self.etas[key].append((1 / each.eta[1], 1 / each.eta[0]))

    @property
    def slopes(self) -> Tabulated:
        """Slopes of the surface that a file of `torchms distil` is about; ValueError for lobes of no one surface."""
        if self.measured is None:
            raise ValueError(f"Distilled.slopes: {', '.join(self.lobes)} is not about one surface. Name a file of one.")
        return Tabulated(*self.measured)

    def n_uniforms(self, vertex: Vertex) -> int:
        if isinstance(vertex, Mirror):
            return 1 + vertex.n_uniforms + MetalProposal.n_uniforms
        return 1 + vertex.n_uniforms + (GlassLobes.n_extra if isinstance(vertex, Refractive) else DiffuseLobes.n_extra)

    def is_deterministic(self, vertex: Vertex) -> bool:
        return True

    def check(self, vertex: Vertex) -> None:
        kind = class_of(vertex.distribution).__name__
        key = self._key(vertex)
        if key not in self.lobes or not isinstance(vertex.distribution, EllipticDistribution | Tabulated):
            raise ValueError(
                f"Distilled(table=...) holds lobes of {', '.join(self.lobes)}; got {FACETS.get(type(vertex), 'facets')} "
                f"with the distribution {kind}. {REMEDY}"
            )
        low, high = self.ranges[key]
        for name, alpha in zip(("alpha", "alpha_y"), vertex.distribution.alphas, strict=True):
            self._within(key, f"{kind}({name}=...)", alpha, (low, high))
        if isinstance(vertex, Refractive):
            self._within(key, "Dielectric(eta=...)", vertex.eta, *self.etas[key])

    def _within(self, key: str, what: str, value: Tensor, *ranges: tuple[float, float]) -> None:
        value = value.detach()
        if value.is_meta or isinstance(value, torch._subclasses.FakeTensor):
            return
        # The range holds for numbers of any precision: 0.03 in float32 is a little less than in float64.
        bad = torch.ones_like(value, dtype=torch.bool)
        for low, high in ranges:
            bad = bad & ((value < low * (1 - 1e-6)) | (value > high * (1 + 1e-6)))
        if bool(bad.any()):
            low, high = ranges[0]
            allowed = "lie in " + " or ".join(f"[{low:g}, {high:g}]" for low, high in ranges)
            traced = isinstance(self.lobes[key], SurfaceLobes | DiffuseSurfaceLobes | GlassSurfaceLobes)
            where = "microsurface" if traced else "approximations"
            other = f"a range of your own run python -m torchms.{where}.distil"
            if low == high:
                allowed, other = f"be {low:g}", "another run torchms distil"
            raise ValueError(
                f"Distilled: {what} must {allowed}, for which its lobes were distilled; got {first_bad(bad, value)}. "
                f"{REMEDY} For {other} and give its file as Distilled(table)."
            )

    def proposal(self, vertex: Vertex) -> Proposal | None:
        return MetalProposal(self._elliptic(vertex)) if isinstance(vertex, Mirror) else None

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        lobes = self.lobes[self._key(vertex)]
        if isinstance(vertex, Mirror):
            assert isinstance(lobes, MetalLobes | SurfaceLobes)
            single, distribution = self.single.evaluate(vertex, wi, wo, u), self._elliptic(vertex)
            if isinstance(lobes, SurfaceLobes):
                return lobes.orders(single[0], distribution, vertex.fresnel, wi, wo)
            return [*single, *lobes.orders(distribution, vertex.fresnel, wi, wo)]
        if isinstance(vertex, Diffuse):
            assert isinstance(lobes, DiffuseLobes)
            return lobes.evaluate(vertex, wi, wo)
        assert isinstance(lobes, GlassLobes) and isinstance(vertex, Refractive)
        return lobes.evaluate(vertex, wi, wo)

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        lobes = self.lobes[self._key(vertex)]
        if isinstance(vertex, Diffuse):
            assert isinstance(lobes, DiffuseLobes)
            yield from lobes.walk(vertex, wi, u)
            return
        if isinstance(vertex, Refractive):
            assert isinstance(lobes, GlassLobes)
            yield from lobes.walk(vertex, wi, u)
            return
        assert isinstance(vertex, Mirror) and isinstance(lobes, MetalLobes | SurfaceLobes)
        distribution = self._elliptic(vertex)

        def rest(d: Vec3) -> tuple[list[Tensor], list[Tensor]]:
            white = lobes.rest(distribution, above(wi), d).lobes
            if isinstance(lobes, SurfaceLobes):
                return lobes.orders(torch.ones_like(d.z), distribution, vertex.fresnel, wi, d)[1:], white
            return lobes.orders(distribution, vertex.fresnel, wi, d), white

        def first(d: Vec3) -> Tensor | None:
            return lobes.rest(distribution, above(wi), above(d)).first if isinstance(lobes, SurfaceLobes) else None

        yield from metal_walk(vertex, self.single, MetalProposal(distribution), rest, wi, u, first)

    def _key(self, vertex: Vertex) -> str:
        return f"{class_of(vertex.distribution).__name__} {FACETS.get(type(vertex), '')}"

    def _elliptic(self, vertex: Vertex) -> EllipticDistribution:
        """What the lobes of metal start from."""
        lobes = self.lobes[self._key(vertex)]
        found = lobes.facets if isinstance(lobes, SurfaceLobes) and lobes.facets is not None else vertex.distribution
        assert isinstance(found, EllipticDistribution)
        return found

    def extra_repr(self) -> str:
        return ", ".join(f"{name} in [{low:g}, {high:g}]" for name, (low, high) in self.ranges.items())


@functools.cache
def packaged(distribution: str, facet: str) -> files.Distillate:
    """The lobes that come with torchms."""
    name = f"distilled_{distribution.lower()}_{facet}.npz"
    with resources.as_file(resources.files("torchms.approximations") / name) as path:
        return files.read(path, NETWORKS)
