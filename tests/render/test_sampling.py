"""Light, surface and both together are sampled without bias, and the standard errors are true."""

import pytest
import torch

from torchms import GGX, RoughConductor, SingleBounce
from torchms.fresnel import Ideal
from torchms.render.camera import Camera
from torchms.render.film import render
from torchms.render.lights import ConstantLight, DirectionalLight, Environment
from torchms.testing import p_value, zscore
from torchms.testing.zscore import Estimate

SLAB = Camera((0.4, 1.5, 0.4), fov=20.0)


def test_the_three_samplings_agree(scene, glass, sky, seed, budget):
    """Metal on the sphere and through the glass slab: light only = BSDF only = both, each channel of the mean."""
    metal = RoughConductor(GGX(0.6, 0.3), Ideal(), SingleBounce())
    p = []
    for shape, camera, bsdf in (("sphere", Camera((0.0, 0.0, 3.0), fov=26.0), metal), ("slab", SLAB, glass)):
        found = {}
        for i, sampling in enumerate(("mis", "light", "bsdf")):
            picture = render(
                scene(shape, sky, bsdf, sampling, inner=3), camera, width=16, height=16, samples=96, seed=seed + i
            )
            error = picture.stderr.double().square().sum((0, 1)).sqrt() / 256
            found[sampling] = Estimate(picture.mean.double().mean((0, 1)), error, 256 * 96)
        p += [p_value(zscore(found["mis"], found[other])) for other in ("light", "bsdf")]
        # The balance heuristic is near the better of the two, and which one that is depends on light and surface.
        worse = torch.maximum(found["light"].stderr, found["bsdf"].stderr)
        assert (found["mis"].stderr < worse).all(), f"{shape}: {found}"
    budget(torch.stack(p))


def test_standard_errors_are_calibrated(scene, mirror, sky, seed, budget):
    """Two pictures with different seeds differ by what their standard errors say."""
    world = scene("sphere", sky, mirror(0.8))
    a, b = (
        render(world, Camera((0.0, 0.0, 3.0), fov=20.0), width=24, height=24, samples=48, seed=seed + i) for i in (0, 1)
    )
    z = ((a.mean - b.mean) / (a.stderr.square() + b.stderr.square()).sqrt())[..., 0].double().reshape(-1)
    assert float(z.square().mean()) == pytest.approx(1, abs=0.25)
    budget(p_value(z.sum() / len(z) ** 0.5))


def test_a_picture_depends_on_the_seed_only(scene, mirror, sky):
    """Not on the threads; another seed gives another picture."""
    world = scene("slab", sky, mirror(0.3))
    pictures = [
        render(world, Camera((1.5, 1.5, 1.5)), width=48, height=48, samples=2, seed=seed, threads=threads)
        for seed, threads in ((3, 1), (3, 2), (4, 2))
    ]
    assert torch.equal(pictures[0].mean, pictures[1].mean)
    assert not torch.equal(pictures[0].mean, pictures[2].mean)


def test_directional_light_is_the_value_itself(scene):
    """A pixel shows E f(wi, wo) cos θ_o; nothing is random in it for a single bounce but the place within the pixel."""
    bsdf = RoughConductor(GGX(0.4), Ideal(), SingleBounce())
    picture = render(
        scene("plane", DirectionalLight((0.0, 1.0, 1.0), 2.5), bsdf),
        Camera((0.0, 2.0, 2.0), fov=0.01),
        width=3,
        height=3,
        samples=2,
    )
    w = torch.tensor([0.0, 0.5**0.5, 0.5**0.5])
    # In the frame of the plane, +y is the normal; both directions are at 45° in one plane.
    torch.testing.assert_close(picture.mean[1, 1], 2.5 * bsdf(w, w).expand(3), rtol=2e-3, atol=0)


def test_environment_density_is_that_of_its_samples(generator, budget):
    """Each texel is drawn in proportion to luminance × solid angle, uniformly within."""
    texels = torch.rand(6, 10, 3, generator=generator) ** 4
    texels[3, 4:7] = 0
    light = Environment(texels)
    n = 200_000
    sample = light.sample(torch.rand(n, 2, generator=generator, dtype=torch.float64))
    torch.testing.assert_close(light.pdf(sample.direction), sample.pdf, rtol=1e-9, atol=0)
    torch.testing.assert_close(light.radiance(sample.direction), sample.radiance)
    torch.testing.assert_close(sample.direction.norm(dim=-1), torch.ones(n, dtype=torch.float64))
    # Means of known integrals over the sphere: ∫ L, and ∫ L ω_y² over the texels' bands.
    rows = torch.linspace(0, torch.pi, 7, dtype=torch.float64).cos()
    columns = texels.double().sum(1) * (2 * torch.pi / 10)
    one = (columns * (rows[:-1] - rows[1:])[:, None]).sum(0)
    y2 = (columns * ((rows[:-1] ** 3 - rows[1:] ** 3) / 3)[:, None]).sum(0)
    p = []
    for factor, truth in ((torch.ones(n), one), (sample.direction[:, 1] ** 2, y2)):
        each = sample.radiance / sample.pdf[:, None] * factor[:, None]
        p.append(p_value((each.mean(0) - truth) / (each.std(0) / n**0.5)))
    # The sphere's solid angle that is not black.
    seen = (rows[:-1] - rows[1:]).sum() * 2 * torch.pi - 3 * (rows[3] - rows[4]) * 2 * torch.pi / 10
    each = 1 / sample.pdf
    p.append(p_value((each.mean() - seen) / (each.std() / n**0.5)).expand(3))
    budget(torch.stack(p))


def test_environment_is_the_right_way_up():
    """The first row is up, the middle column is −z, and what lies right of it is +x."""
    texels = torch.full((4, 8, 3), 0.1)
    texels[0] = 1.0
    texels[2, 4] = 2.0
    texels[2, 6] = 3.0
    light = Environment(texels)
    directions = torch.tensor(
        [[0.0, 1.0, 0.0], [-0.1, -0.1, -1.0], [0.1, -0.1, -1.0], [1.0, -0.1, 0.1]], dtype=torch.float64
    )
    found = light.radiance(torch.nn.functional.normalize(directions, dim=-1))[:, 0]
    torch.testing.assert_close(
        found, torch.tensor([1.0, 0.1, 2.0, 3.0], dtype=torch.float64), check_dtype=False, atol=1e-6, rtol=0
    )
    constant = ConstantLight(0.5)
    assert float(constant.pdf(directions[:1])) == pytest.approx(1 / (4 * torch.pi))
