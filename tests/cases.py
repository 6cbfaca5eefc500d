"""The tables that the laws run over: every law holds what is public to account.

A class that torchms offers and that is not named here joins the tables by itself, made from what its constructor asks for.
"""

import functools
import inspect
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, get_args

import pytest
import torch
from torch import Tensor

import torchms
from torchms import (
    BSDF,
    GGX,
    GTR,
    Beckmann,
    Bidirectional,
    Correlated,
    Distilled,
    HeightWalk,
    Invariance,
    KullaConty,
    MicrofacetDistribution,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    Scattering,
    Segment,
    SingleBounce,
    Stream,
    Tabulated,
    Turquin,
    Uncorrelated,
    Unidirectional,
)
from torchms.distributions.base import EllipticDistribution
from torchms.fresnel import Conductor, Dielectric, Fresnel, Ideal, Schlick
from torchms.maths import frame

NAMED = {value for value in globals().values() if inspect.isclass(value)}
"""Classes with lines of their own, and what they are made of."""


def unnamed(root: type) -> dict[str, type]:
    """The public classes of a kind that have no line, by their names in lower case."""
    offered = [getattr(module, name) for module in (torchms, torchms.fresnel) for name in dir(module)]
    classes = [c for c in offered if inspect.isclass(c) and issubclass(c, root) and c not in NAMED]
    return {c.__name__.lower(): c for c in classes if not inspect.isabstract(c)}


def example(cls: type, alpha: float | Tensor = 0.7, alpha_y: float | Tensor = 0.3, max_order: int = 4) -> Any:
    """One of a class: what it must be given is an argument of that name, or something usual of the type."""
    given = {"alpha": alpha, "alpha_y": alpha_y, "max_order": max_order}
    usual = {MicrofacetDistribution: GGX(alpha, alpha_y), list[float]: [0.2, 0.6, 0.9], float: 0.5, int: 3, bool: True}
    for name, argument in inspect.signature(cls).parameters.items():
        if name not in given and argument.default is argument.empty:
            kinds = (argument.annotation, *get_args(argument.annotation))
            found = [value for kind, value in usual.items() if kind in kinds]
            assert found, f"{cls.__name__}({name}=...): give it a line in tests/cases.py"
            given[name] = found[0]
    return cls(**{name: value for name, value in given.items() if name in inspect.signature(cls).parameters})


def gtr(alpha: float | Tensor, alpha_y: float | Tensor = 0.25) -> GTR:
    """GTR with γ = 1 + 2 α_y, where others have a second roughness, and α moved into its range."""
    inside = alpha.clamp(0.01, 1) if isinstance(alpha, Tensor) else min(max(alpha, 0.01), 1.0)
    return GTR(inside, 1 + 2 * alpha_y)


def tabulated(alpha: float | Tensor, alpha_y: float | Tensor | None = None) -> Tabulated:
    """Slopes of three peaks, skewed and leaning, of rms 1 / √2 along x and y before they are scaled by the α."""
    weights, means = [0.5, 0.3, 0.2], [[0.24, 0.34], [-0.4, -0.1], [0.0, -0.7]]
    covariances = [[[0.3, 0.2], [0.2, 0.25]], [[0.9, -0.3], [-0.3, 0.8]], [[0.05, 0.0], [0.0, 0.1]]]
    return Tabulated(weights, means, covariances, alpha, alpha_y)


ELLIPTIC: dict[str, type[EllipticDistribution]] = {"ggx": GGX, "beckmann": Beckmann}
"""Those with α_x and α_y, which the reference tables and other renderers have as well."""

DISTRIBUTIONS: dict[str, Callable[..., MicrofacetDistribution]] = {
    **ELLIPTIC,
    "gtr": gtr,
    "tabulated": tabulated,
    **{
        name: lambda alpha, alpha_y=0.25, c=cls: example(c, alpha, alpha_y)
        for name, cls in unnamed(MicrofacetDistribution).items()
    },
}

SEGMENTS: dict[str, type[Segment]] = {
    "uncorrelated": Uncorrelated,
    "correlated": Correlated,
    "invariance": Invariance,
    **unnamed(Segment),
}

SCATTERINGS: dict[str, Callable[[int], Scattering]] = {
    "single": lambda max_order: SingleBounce(),
    **{name: lambda max_order, s=segment: Unidirectional(s(), max_order) for name, segment in SEGMENTS.items()},
    "height-walk": HeightWalk,
    **{
        f"bidirectional-{name}": lambda max_order, s=segment: Bidirectional(s(), max_order)
        for name, segment in SEGMENTS.items()
    },
    **{
        name: lambda max_order, c=cls: example(c, max_order=max_order)
        for name, cls in unnamed(Scattering).items()
        if cls.is_unbiased
    },
}

COMPENSATIONS: dict[str, Callable[[int], Scattering]] = {
    "kulla-conty": lambda max_order: KullaConty(),
    "turquin": lambda max_order: Turquin(),
}
"""Closed forms over tables, which only `ELLIPTIC` distributions have."""

DISTILLATES: dict[str, Callable[[int], Scattering]] = {"distilled": lambda max_order: Distilled()}
"""Learned sums over all bounces, of metal whose roughnesses lie within what they were learned for."""

TRACED: dict[str, Callable[[int], Scattering]] = {"distilled-gaussian": lambda max_order: Distilled(surface="gaussian")}
"""Learned from ray-traced surfaces: of metal with Beckmann's normals, not Smith's theory."""

OTHERS: dict[str, Callable[[int], Scattering]] = {
    name: lambda max_order, c=cls: example(c, max_order=max_order)
    for name, cls in unnamed(Scattering).items()
    if not cls.is_unbiased
}
"""Approximations without a line: `law_suite` knows what they must obey, the other tables what they should."""

EVERY_SCATTERING = {**SCATTERINGS, **COMPENSATIONS, **DISTILLATES, **TRACED, **OTHERS}

FRESNELS: dict[str, Callable[[], Fresnel]] = {
    "ideal": Ideal,
    "conductor": lambda: Conductor([0.2, 0.9, 1.2], [3.9, 2.5, 2.2]),
    "schlick": lambda: Schlick([0.04, 0.5, 1.0]),
    "dielectric": lambda: Dielectric(1.5),
    **{name: lambda c=cls: example(c) for name, cls in unnamed(Fresnel).items()},
}
"""What a conductor's slot takes; of a dielectric, what is refracted is lost."""

MATERIALS: dict[str, Callable[[MicrofacetDistribution, Scattering], BSDF]] = {
    **{
        f"conductor[{name}]": lambda d, s, fresnel=fresnel: RoughConductor(d, fresnel(), s)
        for name, fresnel in FRESNELS.items()
    },
    "dielectric": lambda d, s: RoughDielectric(d, Dielectric(1.5), s, "importance"),
    "dielectric[radiance]": lambda d, s: RoughDielectric(d, Dielectric(1.5), s),
    "diffuse": lambda d, s: RoughDiffuse(d, [0.2, 0.6, 1.0], s),
    "diffuse[white]": lambda d, s: RoughDiffuse(d, 1.0, s),
}

LOSSLESS = {"conductor": "conductor[ideal]", "dielectric": "dielectric", "diffuse": "diffuse[white]"}
"""The materials of the reference tables and of the white furnace."""

ONE_OF_EACH = ["conductor[conductor]", "dielectric", "diffuse"]

ALPHAS: dict[str, tuple[float, ...]] = {"0.05": (0.05,), "0.25": (0.25,), "1": (1.0,), "1,0.1": (1.0, 0.1)}
ANGLES = (0.0, 0.5, 1.0, 1.5)

TOLERANCES = {torch.float32: (1e-5, 1e-6), torch.float64: (1e-12, 1e-14)}
"""The one table of (rtol, atol) for numbers that are equal but for rounding."""


def bsdf(
    material: str,
    scattering: str,
    distribution: str = "ggx",
    alpha: tuple[float, ...] = (0.7, 0.3),
    max_order: int = 4,
    dtype: torch.dtype = torch.float64,
) -> BSDF:
    """The BSDF of these names, with buffers of `dtype`."""
    facets = DISTRIBUTIONS[distribution](*alpha)
    return MATERIALS[material](facets, EVERY_SCATTERING[scattering](max_order)).to(dtype)


@functools.cache
def serves(material: str, scattering: str, distribution: str = "ggx", alpha: tuple[float, ...] = (0.7, 0.3)) -> bool:
    """Whether the material takes that scattering; which ones it must refuse is a test of its own."""
    try:
        bsdf(material, scattering, distribution, alpha)
    except ValueError:
        return False
    return True


HEAVY = {"gtr", "tabulated", "bidirectional-uncorrelated"}
"""What is integrated numerically, or costly and made of parts that others test: its laws over tables are slow tests.

GTR and Tabulated have quick ones of their own, tests/unit/distributions/test_gtr.py and test_tabulated.py.
"""

CHOOSING = {"tabulated"}
"""Distributions whose visible normals follow a choice, which jumps at fixed random numbers: gradients are those of the mean."""


def slow_if_heavy(key: Any) -> list[pytest.MarkDecorator]:
    """The marks of a parameter."""
    return [pytest.mark.slow] if key in HEAVY else []


def models(
    materials: Iterable[str] = ONE_OF_EACH,
    scatterings: Iterable[str] = SCATTERINGS,
    where: Callable[[str, str], bool] = lambda material, scattering: True,
) -> pytest.MarkDecorator:
    """Parametrize over material × scattering, as far as the one takes the other, `where` a law is about them."""
    pairs = [(m, s) for m, s in itertools.product(materials, scatterings) if serves(m, s) and where(m, s)]
    return pytest.mark.parametrize(
        "material,scattering",
        [pytest.param(*pair, marks=slow_if_heavy(pair[1]), id="-".join(pair)) for pair in pairs],
    )


def each(name: str, table: Iterable[Any]) -> pytest.MarkDecorator:
    """Parametrize over the keys of a table."""
    return pytest.mark.parametrize(name, [pytest.param(key, marks=slow_if_heavy(key)) for key in table])


def surfaces() -> pytest.MarkDecorator:
    """Parametrize over material × scattering, approximations included, × distribution: whatever can be built.

    Quick are all scatterings of the first distribution, and all distributions with the quickest scatterings.
    """
    found = [
        (m, s, d)
        for m, s, d in itertools.product(ONE_OF_EACH, EVERY_SCATTERING, DISTRIBUTIONS)
        if serves(m, s, d, alphas_for(m, s))
    ]
    quickest = {"single", *COMPENSATIONS, *DISTILLATES, *TRACED}
    slow = [c for c in found if HEAVY & set(c) or (c[2] != next(iter(DISTRIBUTIONS)) and c[1] not in quickest)]
    return pytest.mark.parametrize(
        "material,scattering,distribution",
        [pytest.param(*c, marks=[pytest.mark.slow] if c in slow else [], id="-".join(c)) for c in found],
    )


def alphas_for(material: str, scattering: str) -> tuple[float, ...]:
    """Two roughnesses wherever they are served: compensated glass has one."""
    return (0.6,) if scattering in COMPENSATIONS and transmits(material) else (0.7, 0.3)


def direction(theta: float, phi: float = 0.7, dtype: torch.dtype = torch.float64) -> Tensor:
    """The unit vector (3,) at `theta` from the normal and azimuth `phi` [rad], which is not 0: that hides errors."""
    return frame.direction(theta, phi, dtype)


def directions(
    n: int, generator: torch.Generator, least_cos: float = -1.0, dtype: torch.dtype = torch.float64
) -> Tensor:
    """`n` directions (n, 3), uniform over the part of the sphere where cos θ ≥ `least_cos`."""
    z = least_cos + (1 - least_cos) * torch.rand(n, generator=generator, dtype=torch.float64)
    phi = 2 * math.pi * torch.rand(n, generator=generator, dtype=torch.float64)
    r = (1 - z * z).clamp_min(0).sqrt()
    return torch.stack([r * phi.cos(), r * phi.sin(), z], -1).to(dtype)


def transmits(material: str) -> bool:
    """Whether light gets through."""
    return isinstance(bsdf(material, "single"), torchms.RoughDielectric)


def is_dear(distribution: str, scattering: str) -> bool:
    """Whether every vertex of two walks is a quadrature: the costliest pair of the tables, and the largest graph."""
    return distribution == "gtr" and scattering.startswith("bidirectional")


def sides(material: str) -> tuple[float, ...]:
    """Signs of cos θ_i that the material serves."""
    return (1.0, -1.0) if transmits(material) else (1.0,)


METHODS = {
    "forward": lambda s, wi, wo, u: [s(wi, wo, u)],
    "orders": lambda s, wi, wo, u: [s.orders(wi, wo, u)],
    "sample": lambda s, wi, wo, u: s.sample(wi, u),
    "pdf": lambda s, wi, wo, u: [s.pdf(wi, wo)],
    "sample_walk": lambda s, wi, wo, u: s.sample_walk(wi, u),
    "albedo": lambda s, wi, wo, u: s.albedo(wi, u),
}
"""Every method that evaluates, as a list of tensors."""

NUMBERS: dict[str, Callable[[Sequence[int], int, int], Tensor | Stream]] = {
    "tensor": lambda batch, n_paths, D: Stream(11, n_paths).uniforms(batch, D, torch.float64),
    "stream": lambda batch, n_paths, D: Stream(11, n_paths),
    "seeds": lambda batch, n_paths, D: Stream(Stream(11).seeds(batch), n_paths),
}
"""The same random numbers in every form in which a method takes them: of (batch, N, D)."""
