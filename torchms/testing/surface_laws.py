"""What a BSDF must obey."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor, nn

from torchms.bsdfs.base import BSDF
from torchms.evaluation.arguments import set_validation
from torchms.maths.frame import direction
from torchms.parameters.exchange import parameters, weights, with_parameters
from torchms.sampling.uniforms import draw
from torchms.testing.chi_square import Comparison, compared
from torchms.testing.furnace import white_furnace
from torchms.testing.plain import AZIMUTH, edges, slope_error, unfinished
from torchms.testing.reciprocity import flux, reciprocity
from torchms.testing.report import Check
from torchms.testing.zscore import Estimate, combined, estimate, exactly, p_value, zscore

Numbers = Callable[[Sequence[int], int], Tensor]
"""Random numbers for a batch shape and a number of paths."""

THETAS = (0.4, 1.2)
WHOLE = 1e-3
TOLERANCE = 2e-4
TABLE = 5e-3
"""Most that an energy may exceed 1: approximations read theirs from a table."""
SHARE = 5e-4
"""Shares of an energy that are this close are equal: what is rarer than that may not have been met."""


def surface_laws(bsdf: BSDF, samples: int, generator: torch.Generator, picture: Path | None) -> Iterator[Check]:
    """The laws of values, densities, walks and energies; `bsdf` as `plain` gives it."""
    sides = (1, -1) if bsdf.vertex.transmits else (1,)
    views = {f"θ = {side * t:g}": side * direction(t, AZIMUTH) for side in sides for t in THETAS}

    def numbers(shape: Sequence[int], n: int) -> Tensor:
        return draw(shape, n, bsdf.n_uniforms, generator=generator, dtype=torch.float64)

    @cache
    def sampled(view: str) -> tuple[Comparison, float]:
        """The comparison with `pdf`, and the largest relative error of the density that `sample` returns."""
        wi = views[view]
        wo, pdf = bsdf.sample(wi, numbers((), samples))
        there = bsdf.pdf(wi, wo)
        error = float(((pdf - there).abs() / there.clamp_min(1e-30)).nan_to_num(math.inf).max())
        return compared(wo, lambda w: bsdf.pdf(wi, w), tolerance=TOLERANCE), error

    def adds_up() -> float:
        wi, wo = (direction_set(sides, 64, generator) for _ in range(2))
        u = numbers((64,), 2)
        orders = bsdf.orders(wi, wo, u)
        wrong = (bsdf(wi, wo, u) - orders.sum(-2)).abs() / (1 + orders.sum(-2))
        return max(float(wrong.max()), -float(orders.min()))

    for view in views:
        yield Check(f"pdf is normalised, {view}", lambda view=view: abs(sampled(view)[0].total - 1), WHOLE)
        yield Check(f"sample returns its pdf, {view}", lambda view=view: sampled(view)[1], 1e-6)
        yield Check(f"sample follows pdf, {view}", lambda view=view: sampled(view)[0].p_value(picture))
    yield Check("forward is the sum of the orders, none is negative", adds_up, 1e-9)
    for view, wi in views.items():
        yield Check(f"sample_walk is the value's, {view}", lambda wi=wi: walks(bsdf, wi, samples, numbers))
    yield Check("nothing is gained", lambda: gained(bsdf, views, samples, numbers), TABLE)
    if bsdf.is_lossless and bsdf.max_order >= 3:
        yield Check("white furnace", lambda: lost(bsdf, views, samples, numbers), 0.0)
    if bsdf.scattering.is_reciprocal:
        pair = (direction_set(sides, samples, generator) for _ in range(2))
        if bsdf.scattering.is_deterministic(bsdf.vertex):
            yield Check("reciprocity", lambda: reciprocal_values(bsdf, *pair), 1e-9)
        else:
            yield Check("reciprocity", lambda: reciprocal_walks(bsdf, next(pair), numbers))
    for dtype in (torch.float32, torch.float64):
        yield Check(f"values and gradients are finite, {dtype}", lambda dtype=dtype: finite(bsdf, dtype), 0.0)
    if not bsdf.vertex.phase_needs_normal:
        yield Check("gradients are slopes", lambda: slopes(bsdf, list(views.values()), numbers), 1e-5)


def direction_set(sides: Sequence[int], n: int, generator: torch.Generator) -> Tensor:
    """(n, 3) directions uniform over the sides, no closer to the horizon than cos θ = 0.05."""
    u = draw((n,), 1, 3, generator=generator, dtype=torch.float64)[:, 0]
    z = 0.05 + 0.95 * u[:, 0]
    r, phi = (1 - z * z).sqrt(), 2 * math.pi * u[:, 1]
    side = torch.where((u[:, 2] < 0.5) & (len(sides) > 1), -1.0, 1.0)
    return torch.stack([r * phi.cos(), r * phi.sin(), z * side], -1)


def walks(bsdf: BSDF, wi: Tensor, samples: int, numbers: Numbers) -> tuple[float, str]:
    """∫ f |cos θ_o| g dwo of each order, by `sample` and `orders` and by `sample_walk`, for a few functions g."""

    def moments(wo: Tensor, weight: Tensor) -> Estimate:
        x, y, z = (component[:, None, None] for component in wo.unbind(-1))
        up = (z > 0).to(z.dtype)
        return estimate(torch.stack([weight * g for g in (up, 1 - up, z * z, (1 + x) / 2, (1 + y) / 2)], -1))

    wo, pdf = bsdf.sample(wi, numbers((), samples))
    values = bsdf.orders(wi, wo, numbers((samples,), 1)) / pdf[:, None, None]
    by_value = moments(wo, torch.where(pdf[:, None, None] > 0, values, 0.0))
    wo, weight, order = bsdf.sample_walk(wi, numbers((), samples))
    k = torch.arange(1, bsdf.max_order + 1)
    by_walk = moments(wo, weight[:, None, :] * (order[:, None] == k)[..., None])
    p = p_value(zscore(by_value, by_walk, rounding=SHARE)).nan_to_num(0.0)
    return combined(p.reshape(-1)), f"worst order {1 + int(p.reshape(len(k), -1).amin(1).argmin())}"


def _energies(bsdf: BSDF, views: dict[str, Tensor], samples: int, numbers: Numbers) -> Estimate:
    n = max(256, samples // 10)
    return white_furnace(bsdf, torch.stack(list(views.values())), numbers((len(views),), n))


def gained(bsdf: BSDF, views: dict[str, Tensor], samples: int, numbers: Numbers) -> tuple[float, str]:
    """Largest excess of an energy over 1, beyond five standard errors."""
    energy = _energies(bsdf, views, samples, numbers)
    return float((energy.mean - 5 * energy.stderr).max()) - 1, f"albedo {float(energy.mean.max()):.4f}"


def lost(bsdf: BSDF, views: dict[str, Tensor], samples: int, numbers: Numbers) -> tuple[float, str]:
    """What a lossless surface lacks, beyond what its last orders promise of later ones and five standard errors."""
    n = max(256, samples // 10)
    wi = torch.stack(list(views.values()))[:, None]
    albedo = bsdf.albedo(wi, numbers((len(views), 1), n))
    orders = (albedo.reflected + albedo.transmitted)[:, 0].sum(-1) / albedo.reflected.shape[-1]
    energy = _energies(bsdf, views, samples, numbers)
    ratio = (orders[:, -1] / orders[:, -2].clamp_min(1e-30)).clamp(0, 0.95)
    later = orders[:, -1] * ratio / (1 - ratio)
    lacking = 1 - energy.mean - 3 * later[:, None] - 5 * energy.stderr - SHARE
    return max(0.0, float(lacking.max())), f"albedo {float(energy.mean.min()):.4f} of {bsdf.max_order} orders"


def reciprocal_values(bsdf: BSDF, wi: Tensor, wo: Tensor) -> float:
    """Largest relative difference of the two ways, where values are exact."""
    there, back = reciprocity(bsdf, wi, wo)
    return float(((there.mean - back.mean).abs() / (1e-9 + there.mean.abs() + back.mean.abs())).max())


def reciprocal_walks(bsdf: BSDF, wi: Tensor, numbers: Numbers) -> float:
    """Means of functions that change sign when wi and wo change places, over all of the surface's light: zero.

    Each order and channel. What is less than a percent of an order is not seen.
    """
    wo, weight, order = bsdf.sample_walk(wi, numbers((len(wi),), 1))
    wo, weight, order = wo[:, 0], weight[:, 0], order[:, 0]
    carried = weight * flux(bsdf, wi, wo).reshape(-1, 1)
    k = torch.arange(1, bsdf.max_order + 1)
    carried = carried[:, None, :] * (order[:, None] == k)[..., None]
    features = [lambda w: w[:, 0], lambda w: w[:, 1], lambda w: w[:, 2], lambda w: w[:, 2] ** 2, lambda w: w[:, 0] ** 2]
    features.append(lambda w: torch.ones(len(w), dtype=w.dtype))
    odd = [a(wi) * b(wo) - a(wo) * b(wi) for a, b in itertools.combinations(features, 2)]
    mean = estimate(torch.stack([carried * g[:, None, None] for g in odd], -1))
    return combined(p_value(zscore(mean, exactly(torch.zeros(())), rounding=SHARE)).nan_to_num(0.0).reshape(-1))


def finite(bsdf: BSDF, dtype: torch.dtype) -> tuple[float, str]:
    """Of every method: at the poles, on the horizon, below it, at h = 0, at u = 0 and u → 1."""
    wi, wo = (x.to(dtype).requires_grad_() for x in edges())
    values = {name: value.detach().to(dtype).requires_grad_() for name, (_, value) in parameters(bsdf).items()}
    bsdf.to(dtype)
    values |= {n: x.detach().requires_grad_() for n, x in weights(bsdf).items() if isinstance(x, nn.Parameter)}
    here = with_parameters(bsdf, values)
    most = 1 - torch.finfo(dtype).eps / 2
    rows = torch.tensor([[0.0], [0.5], [most]], dtype=dtype).expand(3, bsdf.n_uniforms)
    mixed = torch.where(torch.arange(bsdf.n_uniforms) % 2 == 0, rows[0], rows[2])
    u = torch.cat([rows, mixed[None]]).expand(len(wi), -1, -1)
    sample, walk, albedo = here.sample(wi, u), here.sample_walk(wi, u), here.albedo(wi, u)
    outputs = {
        "orders": here.orders(wi, wo, u),
        "pdf": here.pdf(wi, wo),
        "sample.wo": sample.wo,
        "sample.pdf": sample.pdf,
        "sample_walk": walk.weight[..., :1] * walk.wo,
        "albedo": albedo.reflected + albedo.transmitted,
    }
    found = unfinished(outputs, {"wi": wi, "wo": wo} | values)
    bsdf.to(torch.float64)
    return found


def slopes(bsdf: BSDF, views: Sequence[Tensor], numbers: Numbers) -> float:
    """Of `pdf` and of what is exact: the first order, or all of them. (Later ones hold their directions.)"""
    wi = torch.stack(list(views))
    wo = torch.stack([side * direction(0.7, 2.0) for side in torch.where(wi[:, 2] > 0, 1, -1).tolist()])
    u = numbers((len(wi),), 1)
    exact = bsdf.scattering.is_deterministic(bsdf.vertex)
    declared = parameters(bsdf)

    def values(given: Sequence[Tensor]) -> Tensor:
        here = with_parameters(bsdf, dict(zip(declared, given, strict=True)))
        orders = here.orders(wi, wo, u)
        return torch.cat([(orders if exact else orders[:, :1]).reshape(-1), here.pdf(wi, wo)])

    # A difference moves a number by 1e-5 of itself: also one that is the end of its range, as an albedo of 1.
    before = set_validation(False)
    try:
        return slope_error(values, [value for _, value in declared.values()])
    finally:
        set_validation(before)
