"""Helmholtz: light goes the same way back, f(wi, wo) / n² = f(wo, wi) / n²."""

import torch
from cases import DISTRIBUTIONS, MATERIALS, bsdf, directions, each, models, serves, transmits

from torchms.testing import p_value, reciprocal_pair, z_score

SMOOTH = [m for m in MATERIALS if not m.startswith("diffuse")]
PAIRS = 8


def pairs(material, generator, n=PAIRS):
    least = -1.0 if transmits(material) else 0.02
    return directions(n, generator, least), directions(n, generator, least)


@each("material", SMOOTH)
@each("distribution", DISTRIBUTIONS)
def test_one_bounce_is_reciprocal(material, distribution, generator):
    """To rounding in float64, η² included, across every pair of sides."""
    there, back = reciprocal_pair(bsdf(material, "single", distribution), *pairs(material, generator, 1000))
    assert (there.mean > 0).double().mean() > 0.3
    torch.testing.assert_close(there.mean, back.mean, rtol=1e-12, atol=1e-15)


@models([*MATERIALS])
def test_the_radiance_mode_is_the_other_ways_adjoint(material, scattering, generator):
    """Radiance is importance over (n_o / n_i)², order by order with the same numbers, and in the walks' weights."""
    if material != "dielectric[radiance]":
        return
    radiance, importance = bsdf(material, scattering), bsdf("dielectric", scattering)
    wi, wo = pairs(material, generator, 200)
    u = radiance.uniforms((200,), 4, generator=generator)
    n = torch.where(wi[:, 2] > 0, 1.5, 1 / 1.5).double()

    def scale(w):
        return torch.where((wi[:, 2] > 0) == (w[..., 2].movedim(-1, 0) > 0), 1.0, n**2).movedim(0, -1)

    torch.testing.assert_close(
        radiance.orders(wi, wo, u) * scale(wo[:, None])[0][:, None, None], importance.orders(wi, wo, u)
    )
    a, b = radiance.sample_walk(wi, u), importance.sample_walk(wi, u)
    torch.testing.assert_close(a.weight[..., 0] * scale(a.wo).T, b.weight[..., 0])
    torch.testing.assert_close(radiance.albedo(wi, u), importance.albedo(wi, u))


@models(["conductor[conductor]", "dielectric", "dielectric[radiance]", "diffuse"])
@each("distribution", DISTRIBUTIONS)
def test_reciprocity_in_expectation(material, scattering, distribution, generator, budget):
    """Every order, where the scattering says so; and where it says that it is not, this test can tell."""
    assert serves(material, scattering)
    surface = bsdf(material, scattering, distribution, max_order=3)
    wi, wo = pairs(material, generator)
    u = surface.uniforms((2, PAIRS), 20_000, generator=generator)
    p = p_value(z_score(*reciprocal_pair(surface, wi, wo, u[0], u[1])))
    if surface.scattering.is_reciprocal:
        budget(p, lambda i: f"pair {i // p[0].numel()}, order {i % p[0].numel() // p.shape[-1] + 1}")
    else:
        assert p[:, 1:].min() < 1e-12
