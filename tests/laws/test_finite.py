"""Value and gradient are finite everywhere: at the pole, the horizon and below it, at h = 0, at u = 0 and u → 1."""

import itertools
import math
from collections.abc import Iterator

import torch
from cases import DISTRIBUTIONS, TOLERANCES, bsdf, direction, each, is_dear, models
from torch import Tensor

from torchms import BSDF

ALPHAS = ((1e-3,), (0.05,), (1.0,), (2.0,), (2.0, 1e-3))
THETAS = (0.0, 1e-4, 0.7, 1.5, math.radians(89.99))
GRAZING = math.pi / 2
DTYPES = {str(dtype).removeprefix("torch."): dtype for dtype in TOLERANCES}


def edges(dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Every wi with every wo (n, 3): both sides, on the horizon, the mirror direction, back along wi, h horizontal, h = 0."""
    rows = []
    for theta, side in itertools.product(THETAS, (1, -1)):
        wi = side * direction(theta)
        x, y, z = wi.unbind(-1)
        special = [wi, -wi, torch.stack([-x, -y, z]), torch.stack([x, y, -z]), torch.stack([-y, x, -z])]
        others = [
            sign * direction(t, phi)
            for t in (*THETAS, GRAZING)
            for sign in (1, -1)
            for phi in (0.7, 0.7 + math.pi, 2.3)
        ]
        flat = [torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64), torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)]
        rows += [(wi, wo) for wo in special + others + flat]
        rows += [(horizontal, wi) for horizontal in flat]
    wi, wo = (torch.stack(column).to(dtype) for column in zip(*rows, strict=True))
    return wi, wo


def numbers(surface: BSDF, dtype: torch.dtype, generator: torch.Generator, n: int = 4) -> Tensor:
    """Paths (2 + 2n, D) of extreme numbers, all alike and `n` mixed, and `n` ordinary ones."""
    least, most = 0.0, 1 - torch.finfo(dtype).eps / 2
    D = surface.n_uniforms
    mixed = torch.where(torch.rand(n, D, generator=generator) < 0.5, least, most)
    ordinary = torch.rand(n, D, generator=generator)
    return torch.cat([torch.full((1, D), least), torch.full((1, D), most), mixed, ordinary]).to(dtype).clamp_max(most)


def parameters(surface: BSDF) -> dict[str, Tensor]:
    """Every declared number, as a leaf that wants a gradient."""
    return {name: value.requires_grad_() for name, value in surface.named_buffers()}


def results(surface: BSDF, wi: Tensor, wo: Tensor, u: Tensor) -> Iterator[tuple[str, Tensor]]:
    """What every public method returns, one graph at a time."""
    yield "forward", surface(wi, wo, u)
    yield "orders", surface.orders(wi, wo, u)
    yield "pdf", surface.pdf(wi, wo)
    sample = surface.sample(wi, u)
    yield "sample.wo", sample.wo
    yield "sample.pdf", sample.pdf
    walk = surface.sample_walk(wi, u)
    yield "walk.wo", walk.wo
    yield "walk.weight", walk.weight
    albedo = surface.albedo(wi, u)
    yield "albedo.reflected", albedo.reflected
    yield "albedo.transmitted", albedo.transmitted


def unfinished(surface: BSDF, leaves: dict[str, Tensor], u: Tensor) -> list[tuple[str, str, list[int]]]:
    """Method, value or gradient, and rows of what is not finite at the edges, with each of the paths `u` (N, D)."""
    wi, wo = edges(u.dtype)
    wanted = {**leaves, "wi": wi.requires_grad_(), "wo": wo.requires_grad_()}
    bad = []
    for method, value in results(surface, wi, wo, u.expand(len(wi), -1, -1)):
        found = {"value": value}
        if value.requires_grad:
            gradients = torch.autograd.grad(value.sum(), list(wanted.values()), retain_graph=True, allow_unused=True)
            found |= {f"d/d{name}": x for name, x in zip(wanted, gradients, strict=True) if x is not None}
        bad += [(method, name, rows_of(x)) for name, x in found.items() if not x.isfinite().all()]
    return bad


@models()
@each("distribution", DISTRIBUTIONS)
@each("dtype", DTYPES)
def test_values_and_gradients_are_finite(material, scattering, distribution, dtype, generator):
    precision = DTYPES[dtype]
    # With all paths the graph is 10 GB.
    n = 1 if is_dear(distribution, scattering) else 4
    bad = {}
    for alpha in ALPHAS:
        surface = bsdf(material, scattering, distribution, alpha, max_order=3, dtype=precision)
        bad[alpha] = unfinished(surface, parameters(surface), numbers(surface, precision, generator, n))
    assert not any(bad.values()), "\n".join(map(str, bad.items()))


def rows_of(value: Tensor) -> list[int]:
    """The first rows that hold something that is not finite."""
    return (~value.isfinite()).reshape(len(value) if value.ndim else 1, -1).any(1).nonzero()[:6, 0].tolist()


@models()
@each("dtype", DTYPES)
def test_many_orders_at_the_ends_of_the_numbers(material, scattering, dtype):
    """Ten orders with all numbers 0, and all next to 1: products along a path may leave the range of a float, unseen."""
    precision = DTYPES[dtype]
    surface = bsdf(material, scattering, alpha=(0.5, 0.3), max_order=10, dtype=precision)
    leaves = list(parameters(surface).values())
    w = torch.stack([direction(0.0), direction(0.7), direction(1.5), direction(2.5)]).to(precision)
    wi, wo = w.repeat_interleave(4, 0).requires_grad_(), w.repeat(4, 1).requires_grad_()
    for number in (0.0, 1 - torch.finfo(precision).eps / 2):
        value = surface.orders(wi, wo, torch.full((1, surface.n_uniforms), number, dtype=precision))
        gradients = torch.autograd.grad(value.sum(), [wi, wo, *leaves], allow_unused=True)
        assert all(x is None or bool(x.isfinite().all()) for x in (value, *gradients))
