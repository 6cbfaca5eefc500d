"""A body that absorbs nothing cannot be seen in a white furnace; the single bounce can."""

import torch

from torchms import GGX, Bidirectional, HeightWalk, Invariance, RoughDielectric, SingleBounce
from torchms.fresnel import Dielectric
from torchms.render.camera import Camera
from torchms.render.film import Picture, render
from torchms.render.lights import ConstantLight
from torchms.testing import p_value

SIZE = {"width": 24, "height": 24}
FILLING = Camera((0.0, 0.0, 3.0), fov=26.0)
"""The sphere fills the picture's square but for some of the corners."""


def on_sphere(picture: Picture) -> torch.Tensor:
    """Pixels that lie on the sphere altogether."""
    y, x = torch.meshgrid(*(torch.arange(24) - 11.5,) * 2, indexing="ij")
    return torch.hypot(x, y) < 10.5


def test_multiple_bounces_give_all_light_back(scene, mirror, seed, budget):
    """Mean over the sphere is 1 within its standard error, at α = 0.7 with 12 orders."""
    picture = render(
        scene("sphere", ConstantLight(), mirror(0.7, Bidirectional(Invariance(), 12))),
        FILLING,
        **SIZE,
        samples=48,
        seed=seed,
    )
    inside = on_sphere(picture)
    mean, error = picture.mean[inside][:, 0].double(), picture.stderr[inside][:, 0].double()
    total = error.square().sum().sqrt() / len(error)
    assert float(total) < 0.005
    budget(p_value((mean.mean() - 1) / total))


def test_one_bounce_is_dark(scene, mirror, seed):
    """At α = 1 more than half of the light is lost in the middle of the disc."""
    picture = render(
        scene("sphere", ConstantLight(), mirror(1.0, SingleBounce())), FILLING, **SIZE, samples=16, seed=seed
    )
    assert float(picture.mean[on_sphere(picture)].mean()) < 0.7
    assert float(picture.mean[11:13, 11:13].mean()) < 0.5


def test_background_and_body_are_one(scene, mirror, seed):
    """Around the sphere, exactly the light."""
    picture = render(
        scene("sphere", ConstantLight(0.25), mirror(), background=True), Camera((0.0, 0.0, 6.0)), **SIZE, samples=2
    )
    assert (picture.mean[0] == 0.25).all() and (picture.stderr[0] == 0).all()
    assert (
        render(scene("sphere", ConstantLight(), mirror()), Camera((0.0, 0.0, 6.0)), **SIZE, samples=2).mean[0] == 0
    ).all()


def test_glass_gives_all_light_back(scene, seed, budget):
    """A sphere and a slab: the η² of the way in is undone on the way out, less than 1 % is still inside."""
    p = []
    for shape, camera, alpha in (
        ("sphere", Camera((0.0, 0.0, 3.0), fov=13.0), 0.1),
        ("slab", Camera((0.4, 1.5, 0.4), fov=4.0), 0.5),
    ):
        bsdf = RoughDielectric(GGX(alpha), Dielectric(1.5), HeightWalk(8))
        picture = render(
            scene(shape, ConstantLight(), bsdf, inner=24), camera, width=12, height=12, samples=48, seed=seed
        )
        inside = picture.mean[..., 0].double()
        error = picture.stderr[..., 0].double().square().sum().sqrt() / 144
        assert float(error) < 0.025
        p.append(p_value((inside.mean() - 1).clamp_max(0).add(0.01).clamp_max(0) / error))
        p.append(p_value((inside.mean() - 1).clamp_min(0) / error))
    budget(torch.stack(p))
