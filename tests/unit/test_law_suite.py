"""The suite of laws: what is right passes, and what is wrong fails the law that it breaks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from cases import COMPENSATIONS, DISTRIBUTIONS, MATERIALS, OTHERS, SCATTERINGS, SEGMENTS, bsdf, each
from torch import Tensor, nn

from torchms import (
    GGX,
    Bidirectional,
    Correlated,
    HeightWalk,
    Invariance,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Uncorrelated,
    Unidirectional,
)
from torchms.fresnel import Dielectric, Ideal, Schlick
from torchms.maths.frame import Vec3
from torchms.paths.segments import Leg
from torchms.sampling.proposals import ReflectionProposal
from torchms.testing import chi_square, law_suite
from torchms.testing.report import Check, Report, tried

SAMPLES = 5_000


@each("distribution", DISTRIBUTIONS)
def test_distributions_obey(distribution):
    report = law_suite(DISTRIBUTIONS[distribution](0.6, 0.3), samples=SAMPLES)
    assert not report.failed, str(report)
    assert len(report.laws) == 15


@each("segment", SEGMENTS)
def test_segments_obey(segment):
    report = law_suite(SEGMENTS[segment]())
    assert not report.failed, str(report)


SURFACES = {
    "gold": lambda: bsdf("conductor[conductor]", "invariance", "ggx", (0.6, 0.3)),
    "glass": lambda: RoughDielectric(GGX(0.5), Dielectric(1.5), HeightWalk(5)),
    "chalk": lambda: RoughDiffuse(GGX(0.5, 0.8), [0.4, 1.0], HeightWalk(4)),
    "white": lambda: RoughConductor(GGX(0.8), Ideal(), Bidirectional(Invariance(), 4)),
    "compensated": lambda: bsdf("conductor[ideal]", "turquin", "ggx", (0.6, 0.3)),
    **{name: lambda name=name: bsdf("conductor[conductor]", name) for name in OTHERS},
}


@each("surface", SURFACES)
def test_surfaces_obey(surface):
    """One of each material, and of each kind of scattering."""
    report = law_suite(SURFACES[surface](), samples=SAMPLES)
    assert not report.failed, str(report)
    assert len(report.laws) >= 30


@pytest.mark.slow
@each("material", MATERIALS)
@each("scattering", {**SCATTERINGS, **COMPENSATIONS, **OTHERS})
@each("distribution", ["ggx", "beckmann"])
def test_the_whole_table_obeys(material, scattering, distribution):
    try:
        surface = bsdf(material, scattering, distribution, (0.5,))
    except ValueError:
        return  # refused: a test of its own
    report = law_suite(surface)
    assert not report.failed, str(report)


# What is wrong, and the laws that must say so.


class DoubleD(GGX):
    """Twice as many normals as there is surface."""

    def normal_density(self, m: Vec3) -> Tensor:
        return 2 * super().normal_density(m)


class LambdaFlipped(GGX):
    """Below the horizon as above it: the area that faces down is that which faces up."""

    def projected_area(self, w: Vec3) -> Tensor:
        return super().projected_area(Vec3(w.x, w.y, w.z.abs()))


class SwappedAxes(GGX):
    """Visible normals of a surface that is turned by 90°."""

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        m = super().visible_normal(Vec3(w.y, w.x, w.z), u0, u1)
        return Vec3(-m.y, m.x, m.z)


class UpperHalf(GGX):
    """A sampler of visible normals that takes a view from below for its mirror image above."""

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        return super().visible_normal(Vec3(w.x, w.y, w.z.abs()), u0, u1)


class Poled(GGX):
    """Divides by the sine of the polar angle."""

    def normal_density(self, m: Vec3) -> Tensor:
        return super().normal_density(m) * (1 + 0 * (m.x / (m.x * m.x + m.y * m.y).sqrt()))


class Detached(GGX):
    """Forgets how D follows the roughness."""

    def normal_density(self, m: Vec3) -> Tensor:
        return super().normal_density(m).detach() + 0 * self.alpha


WRONG_DISTRIBUTIONS: dict[str, tuple[type[GGX], set[str]]] = {
    "D doubled": (DoubleD, {"D is normalised", "D_visible is normalised, above"}),
    "sign of Λ": (LambdaFlipped, {"Λ(−w) = −1 − Λ(w)", "Λ is that of D, above", "D_visible is normalised, below"}),
    "axes": (SwappedAxes, {"sample_visible follows D_visible, above"}),
    "from below": (UpperHalf, {"sample_visible follows D_visible, below"}),
    "pole": (Poled, {"values and gradients are finite, torch.float32"}),
    "no gradient": (Detached, {"gradients are slopes"}),
}


@each("fault", WRONG_DISTRIBUTIONS)
def test_a_wrong_distribution_fails_its_law(fault):
    kind, laws = WRONG_DISTRIBUTIONS[fault]
    report = law_suite(kind(0.7, 0.3), samples=SAMPLES)
    assert laws <= {law.name for law in report.failed}, str(report)


class Claimed(Correlated):
    """Says that it is reciprocal."""

    is_reciprocal = True


class OffByOne(Uncorrelated):
    """Forgets the leg that it came by."""

    def extend(self, state: Tensor, leg: Leg) -> Tensor:
        return state


@pytest.mark.parametrize(
    ("segment", "law"), [(Claimed, "the reversed path has the same term"), (OffByOne, "escape + stay = 1")]
)
def test_a_wrong_segment_fails_its_law(segment, law):
    assert law in {found.name for found in law_suite(segment()).failed}


@dataclass(frozen=True)
class Uneven(ReflectionProposal):
    """A density that leans to one side."""

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        return super().density(wi, wo) * (1 + 0.4 * wo.x)


@dataclass(frozen=True)
class Short(ReflectionProposal):
    """A density that is too small everywhere."""

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        return super().density(wi, wo) * 0.9


class Gains(Schlick):
    """Facets that give back more than they get."""

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        return 4 + 0 * super().reflectance(cos_theta)


def proposing(kind: type[ReflectionProposal]) -> RoughConductor:
    class Wrong(RoughConductor):
        @property
        def proposal(self) -> ReflectionProposal:
            return kind(self.distribution)

    return Wrong(GGX(0.6, 0.4), Ideal(), SingleBounce())


class Leaning(SingleBounce):
    """Values that lean to one side, unlike the walks and the way back."""

    def evaluate(self, vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        return [value * (1 + 0.3 * wo.x) for value in super().evaluate(vertex, wi, wo, u)]


class Loses(HeightWalk):
    """Walks that lose a tenth of their light at every bounce; values do as well."""

    def walk(self, vertex, wi: Vec3, u: Sequence[Tensor]):
        for leg in super().walk(vertex, wi, u):
            yield leg._replace(weight=0.9 * leg.weight)


WRONG_SURFACES: dict[str, tuple[Callable[[], nn.Module], set[str]]] = {
    "D doubled": (
        lambda: RoughConductor(DoubleD(0.6, 0.4), Ideal(), SingleBounce()),
        {"DoubleD: D is normalised", "pdf is normalised, θ = 0.4", "sample_walk is the value's, θ = 0.4"},
    ),
    "wrong pdf": (lambda: proposing(Uneven), {"sample follows pdf, θ = 0.4", "sample follows pdf, θ = 1.2"}),
    "short pdf": (lambda: proposing(Short), {"pdf is normalised, θ = 0.4"}),
    "gain": (lambda: RoughConductor(GGX(0.6), Gains(0.5), SingleBounce()), {"nothing is gained"}),
    "leaning": (
        lambda: RoughConductor(GGX(0.6), Ideal(), Leaning()),
        {"reciprocity", "sample_walk is the value's, θ = 1.2"},
    ),
    "loss": (
        lambda: RoughConductor(GGX(0.6), Ideal(), Loses(4)),
        {"white furnace", "sample_walk is the value's, θ = 0.4"},
    ),
}


@each("fault", WRONG_SURFACES)
def test_a_wrong_surface_fails_its_law(fault):
    make, laws = WRONG_SURFACES[fault]
    report = law_suite(make(), samples=SAMPLES)
    assert laws <= {law.name for law in report.failed}, str(report)


# How small a fault may be.


def scaled(walks: float, values: Callable[[Vec3], Tensor | float], kind: type = SingleBounce, *arguments: int):
    """Facets that absorb nothing, whose walks and values are multiplied."""

    class Scaled(kind):
        def walk(self, vertex, wi: Vec3, u: Sequence[Tensor]):
            for leg in super().walk(vertex, wi, u):
                yield leg._replace(weight=walks * leg.weight)

        def evaluate(self, vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
            return [value * values(wo) for value in super().evaluate(vertex, wi, wo, u)]

    return RoughConductor(GGX(0.6, 0.4), Ideal(), Scaled(*arguments))


@dataclass(frozen=True)
class Slightly(ReflectionProposal):
    """A density that is 0.2 % too large."""

    def density(self, wi: Vec3, wo: Vec3) -> Tensor:
        return super().density(wi, wo) * 1.002


SMALL: dict[str, tuple[Callable[[], nn.Module], str]] = {
    "pdf 0.2 % too large": (lambda: proposing(Slightly), "pdf is normalised, θ = 0.4"),
    "values 4 % above the walks": (lambda: scaled(1.0, lambda wo: 1.04), "sample_walk is the value's, θ = 0.4"),
    "energy 1 % too large": (lambda: scaled(1.01, lambda wo: 1.01, HeightWalk, 4), "nothing is gained"),
    "energy 2 % too small": (lambda: scaled(0.98, lambda wo: 0.98, HeightWalk, 8), "white furnace"),
    "values that lean by 2 %": (lambda: scaled(1.0, lambda wo: 1 + 0.02 * wo.x), "reciprocity"),
}
"""As the docstring of `law_suite` says."""


@each("fault", SMALL)
def test_a_small_fault_is_found(fault):
    make, law = SMALL[fault]
    report = law_suite(make())
    assert law in {found.name for found in report.failed}, str(report)


def test_no_false_alarm_in_fifty_seeds():
    """`level`, 1e-4, is the probability of one a suite; and p-values are not too large either."""
    reports = [law_suite(GGX(0.5, 0.3), samples=1_000, seed=seed) for seed in range(50)]
    assert not [report for report in reports if report.failed]
    chances = torch.tensor([law.figure for report in reports for law in report if law.is_chance])
    assert 0.03 < float((chances < 0.1).double().mean()) < 0.2


# The suite itself.


def test_the_report_is_a_table_and_repeats():
    first, again = (law_suite(GGX(0.5), samples=1_000, seed=3) for _ in range(2))
    assert first == again and first.laws != law_suite(GGX(0.5), samples=1_000, seed=4).laws
    assert str(first).startswith("GGX: 15 of 15 laws hold\n  ok")
    assert "FAILED D is normalised" in str(law_suite(DoubleD(0.5), samples=1_000))


def test_what_is_tried_is_not_touched():
    """Neither its dtype, nor its graph, nor its maps of parameters."""
    alpha = nn.Parameter(torch.rand(2, 3) * 0.5 + 0.2)
    surface = RoughConductor(GGX(alpha), Schlick(torch.rand(2, 3, 3)), Unidirectional(Invariance(), 2))
    before = {name: value.clone() for name, value in surface.state_dict().items()}
    law_suite(surface, samples=500)
    assert surface.distribution.alpha is alpha and alpha.grad is None and surface.dtype == torch.float32
    assert all(torch.equal(value, before[name]) for name, value in surface.state_dict().items())


def test_an_error_is_a_failed_law():
    def broken() -> float:
        raise RuntimeError("no such thing")

    law = tried(Check("works", broken, 1.0), 1e-3)
    assert not law.passed and law.note == "RuntimeError: no such thing"
    assert Report("it", (law,)).failed == (law,)


def test_a_chi_square_that_fails_is_drawn(tmp_path):
    def uniform(w: Tensor) -> Tensor:
        return torch.full((len(w),), 0.25 / torch.pi, dtype=w.dtype)

    wrong, right, suite = (tmp_path / name for name in ("wrong.png", "right.png", "suite.png"))
    generator = torch.Generator().manual_seed(0)
    w = nn.functional.normalize(torch.randn(5_000, 3, generator=generator), dim=-1)
    chi_square(w, uniform, (8, 8), picture=right)
    chi_square(w * torch.tensor([1.0, 1.0, -1.0]).where(w[:, 2:] < 0, 1.0), uniform, (8, 8), picture=wrong)
    law_suite(UpperHalf(0.7), samples=2_000, picture=suite)
    assert wrong.stat().st_size > 10_000 and suite.stat().st_size > 10_000 and not right.exists()
    assert Path(wrong).read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("messages")
def test_another_kind_of_object_is_refused():
    with pytest.raises(TypeError, match=r"takes a BSDF, a MicrofacetDistribution or a Segment; got Ideal"):
        law_suite(Ideal())
