"""White furnace: with facets that absorb nothing, all light comes back."""

import torch
from cases import ALPHAS, ANGLES, DISTRIBUTIONS, LOSSLESS, SCATTERINGS, bsdf, direction, each, models, sides

from torchms.maths.frame import Vec3
from torchms.testing import white_furnace

every_lossless_model = models(LOSSLESS.values())


@models(LOSSLESS.values(), [name for name in SCATTERINGS if name != "single"])
@each("distribution", DISTRIBUTIONS)
def test_the_furnace_is_white(material, scattering, distribution, generator):
    """E_r + E_t over 20 orders is 1 within 1e-3 for α ≤ 1, lit from each side; it is never more than 1."""
    for alpha in ALPHAS.values():
        surface = bsdf(material, scattering, distribution, alpha, max_order=20)
        wi = torch.stack([direction(theta) * side for theta in ANGLES for side in sides(material)])
        energy = white_furnace(surface, wi, surface.uniforms((len(wi),), 2000, generator=generator))
        assert (energy.mean < 1 + 1e-9).all()
        assert (energy.mean > 1 - 1e-3).all(), f"alpha = {alpha}: {energy.mean.squeeze(-1).tolist()}"


@each("distribution", DISTRIBUTIONS)
def test_one_bounce_is_dark(distribution, generator):
    """What the furnace test is for: a single bounce at α = 1 loses more than half at normal incidence."""
    surface = bsdf("conductor[ideal]", "single", distribution, (1.0,))
    energy = white_furnace(surface, direction(0.0)[None], surface.uniforms((1,), 20_000, generator=generator))
    assert 0.25 < float(energy.mean) < 0.5


@every_lossless_model
@each("distribution", DISTRIBUTIONS)
def test_a_walk_leaves_with_a_probability(material, scattering, distribution, generator):
    """Along every single walk the escape probabilities are ≥ 0 and sum to at most 1, so number 0 can choose among them."""
    for alpha in ALPHAS.values():
        surface = bsdf(material, scattering, distribution, alpha, max_order=8)
        numbers = surface.uniforms((1,), 2000, generator=generator).permute(2, 1, 0).unbind(0)
        for theta in ANGLES:
            for side in sides(material):
                wi = Vec3(*(direction(theta) * side).reshape(3, 1, 1).unbind(0))
                escapes = torch.stack(
                    [leg.escapes.expand(2000, 1) for leg in surface.scattering.walk(surface.vertex, wi, numbers)]
                )
                assert (escapes >= 0).all()
                assert (escapes.sum(0) <= 1 + 1e-9).all()
