"""What a distribution of microfacet normals must obey."""

import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.maths.frame import direction
from torchms.parameters.exchange import parameters, with_parameters
from torchms.sampling.uniforms import draw
from torchms.testing.chi_square import Comparison, compared
from torchms.testing.plain import AZIMUTH, edges, slope_error, unfinished
from torchms.testing.quadrature import sphere_cells
from torchms.testing.report import Check

VIEWS = {"above": direction(0.6, AZIMUTH), "grazing": direction(1.4, 2.0), "below": direction(2.2, -1.0)}
WHOLE = 1e-3
"""Error of an integral over the sphere."""
TOLERANCE = 2e-4


def distribution_laws(
    facets: MicrofacetDistribution, samples: int, generator: torch.Generator, picture: Path | None
) -> Iterator[Check]:
    """The laws of D, Λ and the visible normals; `facets` as `plain` gives it."""

    @cache
    def visible(where: str) -> Comparison:
        w = VIEWS[where]
        m = facets.sample_visible(w, draw((samples,), 1, 2, generator=generator, dtype=torch.float64)[..., 0, :])
        return compared(m, lambda h: facets.D_visible(w, h), tolerance=TOLERANCE)

    def normalised() -> float:
        return abs(float(sphere_cells(lambda m: facets.D(m) * m[:, 2], tolerance=TOLERANCE).sum()) - 1)

    def faces_up() -> float:
        return float(facets.D(torch.stack([-direction(t, AZIMUTH) for t in (0.0, 0.5, 1.5, math.pi / 2)])).abs().max())

    def projected_area(w: Tensor) -> float:
        # [Heitz2016]: Λ(w) = σ(w) / w_z − 1 with σ(w) = ∫ ⟨w, m⟩ D(m) dm.
        area = sphere_cells(lambda m: facets.D(m) * (m @ w).clamp_min(0), tolerance=TOLERANCE * 0.1).sum()
        from_lambda = (1 + facets.Lambda(w)) * w[2]
        return float((from_lambda - area).abs() / (area.abs() + 0.1))

    def antisymmetric() -> float:
        w = torch.stack([direction(t, p) for t in (0.1, 0.8, 1.3, 1.55) for p in (0.0, 0.7, 2.5)])
        up, down = facets.Lambda(w), facets.Lambda(-w)
        return float(((down + 1 + up).abs() / (1 + up)).max())

    yield Check("D is normalised", normalised, WHOLE)
    yield Check("D is 0 at and below the horizon", faces_up, 0.0)
    for where, w in VIEWS.items():
        yield Check(f"Λ is that of D, {where}", lambda w=w: projected_area(w), WHOLE)
    yield Check("Λ(−w) = −1 − Λ(w)", antisymmetric, 1e-9)
    for where in VIEWS:
        yield Check(f"D_visible is normalised, {where}", lambda where=where: abs(visible(where).total - 1), WHOLE)
        name = f"sample_visible follows D_visible, {where}"
        yield Check(name, lambda where=where: visible(where).p_value(picture))
    for dtype in (torch.float32, torch.float64):
        yield Check(f"values and gradients are finite, {dtype}", lambda dtype=dtype: finite(facets, dtype), 0.0)
    yield Check("gradients are slopes", lambda: slopes(facets), 1e-5)


def finite(facets: MicrofacetDistribution, dtype: torch.dtype) -> tuple[float, str]:
    """At the poles, on the horizon, below it, at u = 0 and u → 1."""
    w, m = (x.to(dtype).requires_grad_() for x in edges())
    values = {name: value.detach().to(dtype).requires_grad_() for name, (_, value) in parameters(facets).items()}
    here = with_parameters(facets, values)
    ends = torch.tensor([0.0, 0.5, 1 - torch.finfo(dtype).eps / 2], dtype=dtype)
    outputs = {
        "D": here.D(m),
        "Lambda": here.Lambda(w),
        "D_visible": here.D_visible(w, m),
        "sample_visible": here.sample_visible(w[:, None], torch.cartesian_prod(ends, ends)),
    }
    return unfinished(outputs, {"w": w, "m": m} | values)


def slopes(facets: MicrofacetDistribution) -> float:
    """Of D, Λ and D_visible, in every parameter."""
    w = torch.stack(list(VIEWS.values()))
    m = torch.stack([direction(0.2, 0.3), direction(0.5, 2.0), direction(1.1, -0.5)])

    declared = parameters(facets)

    def values(given: Sequence[Tensor]) -> Tensor:
        here = with_parameters(facets, dict(zip(declared, given, strict=True)))
        return torch.cat([here.D(m), here.Lambda(w), here.D_visible(w, m)])

    return slope_error(values, [value for _, value in declared.values()])
