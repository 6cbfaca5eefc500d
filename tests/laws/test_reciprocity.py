"""Helmholtz: light goes the same way back, f(wi, wo) / n² = f(wo, wi) / n²."""

import torch
from cases import DISTRIBUTIONS, MATERIALS, bsdf, directions, each, is_dear, models, transmits

from torchms.testing import p_value, reciprocity, zscore

SMOOTH = [m for m in MATERIALS if not m.startswith("diffuse")]
PAIRS = 8
FLOOR = 3e-5
"""[1/sr]; values are 0.01 and more."""


def pairs(material, generator, n=PAIRS, least=0.02):
    """Two times `n` directions with |cos θ| ≥ `least`, on both sides of glass."""
    w = directions(2 * n, generator, least)
    if transmits(material):
        w = w * torch.where(torch.rand(2 * n, 1, generator=generator) < 0.5, -1.0, 1.0)
    return w[:n], w[n:]


@each("material", SMOOTH)
@each("distribution", DISTRIBUTIONS)
def test_one_bounce_is_reciprocal(material, distribution, generator):
    """To rounding in float64, η² included, across every pair of sides."""
    there, back = reciprocity(bsdf(material, "single", distribution), *pairs(material, generator, 1000))
    assert (there.mean > 0).double().mean() > 0.3
    torch.testing.assert_close(there.mean, back.mean, rtol=1e-12, atol=1e-15)


@models(["dielectric[radiance]"])
def test_radiance_is_importance_over_eta_squared(material, scattering, generator):
    """Order by order with the same numbers and in the walks' weights; energies carry no η²."""
    radiance, importance = bsdf(material, scattering), bsdf("dielectric", scattering)
    wi, wo = pairs(material, generator, 200)
    u = radiance.uniforms((200,), 4, generator=generator)
    a, b = radiance.sample_walk(wi, u), importance.sample_walk(wi, u)
    for there, ours, theirs in (
        (wo, radiance.orders(wi, wo, u), importance.orders(wi, wo, u)),
        (a.wo, a.weight, b.weight),
    ):
        n = torch.where(wi[:, 2] > 0, 1.5, 1 / 1.5).double().reshape(-1, *[1] * (there.ndim - 2))
        crossed = (there[..., 2] > 0) != (wi[:, 2] > 0).reshape(n.shape)
        eta2 = torch.where(crossed, n**2, 1.0)
        torch.testing.assert_close(ours * eta2.reshape(eta2.shape + (1,) * (ours.ndim - eta2.ndim)), theirs)
    torch.testing.assert_close(radiance.albedo(wi, u), importance.albedo(wi, u))


@models(
    ["conductor[conductor]", "dielectric", "dielectric[radiance]", "diffuse"],
    where=lambda material, scattering: bsdf(material, scattering).scattering.is_reciprocal,
)
@each("distribution", DISTRIBUTIONS)
def test_reciprocity_in_expectation(material, scattering, distribution, generator, budget):
    """Every order, where the scattering says so. (test_path_integral shows that the others are not.)

    The surface is very rough and `FLOOR` is allowed for: the one way may find what is too rare for the other, whose mean
    is then not normal.
    """
    surface = bsdf(material, scattering, distribution, (1.0, 0.6), max_order=3)
    wi, wo = pairs(material, generator, least=0.3)
    n = 6_000 if is_dear(distribution, scattering) else 20_000  # two walks are less noisy than one
    u = surface.uniforms((2, PAIRS), n, generator=generator)
    p = p_value(zscore(*reciprocity(surface, wi, wo, u[0], u[1]), rounding=FLOOR))
    budget(p, lambda i: f"pair {i // p[0].numel()}, order {i % p[0].numel() // p.shape[-1] + 1}")
