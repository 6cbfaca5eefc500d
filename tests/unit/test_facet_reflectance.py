"""What the facets of an order reflect: means of four functions stand for every Fresnel term."""

import pytest
import torch
from torch import Tensor

from torchms.approximations.facet_reflectance import Met, mean_reflectances, reflected, shapes
from torchms.fresnel import Conductor, Dielectric, Ideal, Schlick
from torchms.fresnel.base import Fresnel

METALS = ("Ag", "Al", "Au", "Cr", "Cu", "W")


def facets(generator: torch.Generator, orders: int = 3) -> Tensor:
    """Cosines (64, 4096, orders) of paths: Beta distributions of 64 means and widths."""
    concentration = 1.5 + 6 * torch.rand(64, 2, generator=generator)
    u = torch.rand(64, 4096, orders, generator=generator, dtype=torch.float64)
    a, b = (x[:, None, None] for x in concentration.double().unbind(-1))
    # Kumaraswamy's distribution, whose inverse is closed.
    return (1 - (1 - u) ** (1 / b)) ** (1 / a)


def seen(c: Tensor) -> Met:
    """What `Met` says of the cosines (n, paths, orders)."""
    first, second, third = (x.mean((1, 2))[None] for x in shapes(c))
    x = shapes(c)[0]
    n = c.shape[-1]
    pairs = ((x.sum(-1) ** 2 - (x * x).sum(-1)) / (n * (n - 1))).mean(1)[None] if n > 1 else first**2
    return Met(first, second, third, pairs / first**2 - 1)


def means(fresnel: Fresnel, c: Tensor) -> tuple[Tensor, Tensor]:
    """F̄ of `Met`, and the mean over the facets (C, 1, n)."""
    _, (found,) = mean_reflectances(fresnel.double(), [seen(c)])
    return found, fresnel.reflectance(c).mean((-1, -2))[:, None]


@pytest.mark.parametrize("metal", METALS)
def test_metals(metal: str, generator):
    found, exact = means(Conductor.metal(metal), facets(generator))
    torch.testing.assert_close(found, exact, rtol=6e-3, atol=0)


def test_curves_that_are_sums_of_the_functions(generator):
    """Schlick's, one that is 1, and glass to three per cent."""
    c = facets(generator)
    for fresnel in (Schlick([0.04, 0.3, 0.9]), Ideal()):
        found, exact = means(fresnel, c)
        torch.testing.assert_close(found, exact.expand_as(found), rtol=1e-6, atol=1e-7)
    found, exact = means(Dielectric(1.5), c)
    torch.testing.assert_close(found, exact, rtol=3e-2, atol=0)


def test_products_over_dependent_facets(generator):
    """Schlick's curve over two facets of which one is met squarely where the other is not: exact. Over three what all of
    them have in common is left out, which is little for a metal."""
    c = facets(generator, 1)
    other = 1 - 0.8 * c
    for paths, f0, rtol in (
        (torch.cat([c, other], -1), [0.04, 0.5, 1.0], 1e-6),
        (torch.cat([c, other, c.roll(1, 1)], -1), [0.7, 0.9, 1.0], 1e-2),
    ):
        fresnel, orders = Schlick(f0).double(), paths.shape[-1]
        seen_by_all = seen(paths)
        facing, (F,) = mean_reflectances(fresnel, [seen_by_all])
        found = reflected(facing, [F] * 3, [seen_by_all] * 3, torch.zeros_like(F))[orders - 2]
        exact = fresnel.reflectance(paths).prod(-1).mean(-1)[:, None]
        torch.testing.assert_close(found, exact, rtol=rtol, atol=1e-8)


def test_the_tail_is_the_sum_of_its_orders():
    """Of all orders from 4 on, with their pairs of facets."""
    F, fall, spread = 0.6, 0.7, 0.3
    met = Met(*(torch.tensor([[x]], dtype=torch.float64) for x in (0.1, 0.1, 0.1, spread)))
    facing, mean, r = (torch.tensor([[x]], dtype=torch.float64) for x in (0.4, F, fall))
    found = reflected(facing, [mean] * 3, [met] * 3, r)[2]
    pair = spread * (F - 0.4) ** 2
    exact = sum((1 - fall) * fall ** (k - 4) * (F**k + k * (k - 1) / 2 * F ** (k - 2) * pair) for k in range(4, 200))
    assert float(found) == pytest.approx(exact, rel=1e-12)
