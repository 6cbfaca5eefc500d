"""Distilled lobes of rough glass: reciprocity, symmetries and order 1 by construction, and how close the rest is."""

import math

import pytest
import torch
from cases import DISTILLATES, ELLIPTIC, TOLERANCES, bsdf, direction, directions, each
from test_distilled import turned
from test_finite import numbers, parameters, unfinished
from torch import Tensor

from torchms import BSDF, GGX, GTR, Distilled, HeightWalk, RoughDielectric, Stream
from torchms.fresnel import Dielectric
from torchms.testing import p_value, reciprocity

ALPHAS = ((0.03,), (0.25,), (1.0,), (0.5, 0.15), (1.0, 0.1))
ETAS = (1.1, 1.5, 2.0, 1 / 1.5, 3.0)
every = [each("scattering", DISTILLATES), each("distribution", ELLIPTIC)]


def on_all(test):
    """Parametrize over distilled model × distribution."""
    for mark in every:
        test = mark(test)
    return test


def glass(distribution: str, alpha: tuple[float, ...], eta: float, dtype: torch.dtype = torch.float64) -> BSDF:
    """Glass without the η² of radiance."""
    index = Dielectric(torch.tensor(eta, dtype=dtype))
    return RoughDielectric(ELLIPTIC[distribution](*alpha), index, Distilled(), "importance").to(dtype)


@on_all
def test_reciprocity_and_the_symmetries_of_the_surface(scattering, distribution, generator):
    """f / n² with directions exchanged, on either side; mirrored axes; axes exchanged with their roughnesses."""
    wi, wo = directions(300, generator), directions(300, generator)
    for alpha in ALPHAS:
        for eta in ETAS:
            surface = glass(distribution, alpha, eta)
            there, back = reciprocity(surface, wi, wo)
            torch.testing.assert_close(there.mean, back.mean, rtol=1e-8, atol=1e-14)
            values = surface.orders(wi, wo)
            exchanged = glass(distribution, alpha[::-1], eta)
            for other, change in ((surface, {"x": -1.0}), (surface, {"y": -1.0}), (exchanged, {"swapped": True})):
                same = other.orders(turned(wi, **change), turned(wo, **change))
                torch.testing.assert_close(same, values, rtol=1e-8, atol=1e-11)


@on_all
def test_the_sides_are_exchanged_with_the_index(scattering, distribution, generator):
    """From the inside, η is what 1 / η is from the outside."""
    wi, wo = directions(200, generator), directions(200, generator)
    one, other = glass(distribution, (0.6, 0.3), 1.6), glass(distribution, (0.6, 0.3), 1 / 1.6)
    torch.testing.assert_close(one.orders(wi, wo), other.orders(-wi, -wo), rtol=1e-8, atol=1e-12)


@on_all
def test_first_order_is_the_single_bounce(scattering, distribution, generator):
    """To the bit; the rest is positive on both sides, and no order has its own after it."""
    surface, single = bsdf("dielectric", scattering, distribution), bsdf("dielectric", "single", distribution)
    wi, wo = directions(200, generator), directions(200, generator)
    orders = surface.orders(wi, wo)
    assert orders.shape[-2] == surface.max_order == 4
    assert (orders[:, 1] > 0).all() and (orders[:, 2:] == 0).all()
    torch.testing.assert_close(orders[:, 0], single(wi, wo), rtol=0, atol=0)
    torch.testing.assert_close(orders.sum(1), surface(wi, wo))


@on_all
def test_walks_are_the_lobes(scattering, distribution, generator, budget):
    """Energy of the rest on either side: by `albedo`'s walks, and by directions of the rest's own density."""
    p = []
    for eta in (1.5, 1 / 1.5):
        surface = glass(distribution, (0.7, 0.3), eta)
        wi = torch.tensor([[0.48, 0.64, 0.6]], dtype=torch.float64)
        u = surface.uniforms((1,), 20_000, generator=generator)
        legs = surface.albedo(wi, u)
        exits = surface.sample(wi, surface.uniforms((1,), 20_000, generator=generator))
        value = surface.orders(wi[:, None], exits.wo)[0, :, 1, 0] / exits.pdf[0]
        for side, found in ((1.0, legs.reflected[0, 1, 0]), (-1.0, legs.transmitted[0, 1, 0])):
            mine = torch.where(exits.wo[0, :, 2] * side > 0, value, 0.0)
            error = float(mine.std()) / math.sqrt(len(mine))
            # The walk's own error is about that of the other estimate.
            z = (float(mine.mean()) - float(found)) / (1.5 * error)
            p.append(p_value(torch.tensor(z, dtype=torch.float64)))
    budget(torch.stack(p))


@on_all
def test_values_and_gradients_are_finite(scattering, distribution, generator):
    """At the pole, the horizon and beyond, at the ends of the range, in both precisions."""
    bad = {}
    for dtype in TOLERANCES:
        for alpha, eta in (((0.03,), 1.5), ((1.0,), 1.001), ((1.0, 0.03), 3.0), ((0.3,), 1 / 3)):
            surface = glass(distribution, alpha, eta, dtype)
            leaves = {name: x for name, x in parameters(surface).items() if "scattering" not in name}
            bad[dtype, alpha, eta] = unfinished(surface, leaves, numbers(surface, dtype, generator)[:4])
    assert not any(bad.values()), bad


@on_all
def test_gradients_are_exact(scattering, distribution, generator):
    """d orders / d (α_x, α_y, η, directions): gradcheck in float64, reflected and transmitted."""
    wi, wo = directions(3, generator, 0.2), directions(3, generator, 0.2)
    start = [torch.tensor(x, dtype=torch.float64) for x in (0.6, 0.35, 1.5)]
    start = [x.requires_grad_() for x in (*start, wi, wo)]
    kind, model = ELLIPTIC[distribution], DISTILLATES[scattering](4).double()

    def both(ax: Tensor, ay: Tensor, eta: Tensor, i: Tensor, o: Tensor) -> Tensor:
        i, o = (torch.nn.functional.normalize(w, dim=-1) for w in (i, o))
        surface = RoughDielectric(kind(ax, ay), Dielectric(eta), model)
        return torch.stack([surface.orders(i, o)[..., 1, :], surface.orders(i, -o)[..., 1, :]])

    assert torch.autograd.gradcheck(both, start, eps=1e-6, atol=1e-6, rtol=1e-4)


@pytest.mark.slow
@on_all
def test_the_rest_is_that_of_the_height_walk(scattering, distribution, seed):
    """RMS of the error of either side's lobe: the median over roughnesses, indices and angles, noise taken out."""
    generator = torch.Generator().manual_seed(seed)
    errors: dict[float, list[float]] = {1.0: [], -1.0: []}
    n = 200
    for alpha in ((0.1,), (0.3,), (1.0,), (0.5, 0.15)):
        for eta in (1.5, 2.0, 1 / 1.5, 0.5):
            surface = glass(distribution, alpha, eta, torch.float32)
            walk = RoughDielectric(surface.distribution, surface.fresnel, HeightWalk(10), "importance")
            for theta in (0.0, 0.7, 1.3):
                wi = torch.tensor([math.sin(theta) * 0.8, math.sin(theta) * 0.6, math.cos(theta)]).expand(n, 3)
                for side in errors:
                    wo = directions(n, generator, 0.0, torch.float32) * side
                    a, b = (
                        walk.orders(wi, wo, Stream(seed % 2**20 + half, 200))[..., 1:, 0].sum(-1) for half in (0, 1)
                    )
                    orders = surface.orders(wi, wo)[..., 0]
                    product = ((orders[:, 1] - a) * (orders[:, 1] - b)).mean()
                    size = (orders[:, 0] + 0.5 * (a + b)).square().mean()
                    errors[side].append(float((product / size).clamp_min(0).sqrt()))
    medians = {side: sorted(found)[len(found) // 2] for side, found in errors.items()}
    assert medians[1.0] < 0.04 and medians[-1.0] < 0.02, medians


OFF = {0.25: (0.01, 0.04), 0.5: (0.022, 0.1), 1.0: (0.06, 0.2)}
"""α_x up to which R + T is within these, root mean square and at most, of 1; up to 1.4 rad, for η from 1 / 2 to 2."""


@pytest.mark.slow
@on_all
def test_energy_is_kept(scattering, distribution, seed):
    """R + T by walks, whose noise is a tenth of the bounds."""
    off: dict[float, list[Tensor]] = {most: [] for most in OFF}
    for alpha in ((0.05,), (0.1,), (0.25,), (0.5,), (0.5, 0.15), (1.0,), (1.0, 0.1), (1.0, 0.3)):
        most = min(m for m in OFF if alpha[0] <= m)
        for eta in (1.1, 1.5, 2.0, 1 / 1.1, 1 / 1.5, 0.5):
            surface = glass(distribution, alpha, eta, torch.float32)
            wi = torch.stack([direction(theta, 0.4, torch.float32) for theta in (0.0, 0.5, 1.0, 1.4)])
            legs = surface.albedo(wi, Stream(seed % 2**20, 1 << 13, "sobol"))
            off[most].append((legs.reflected + legs.transmitted)[..., 0].sum(-1) - 1)
    for most, found in off.items():
        error = torch.cat(found)
        rms, worst = OFF[most]
        assert float(error.square().mean().sqrt()) < rms and float(error.abs().max()) < worst, (most, error)


@pytest.mark.usefixtures("messages")
def test_what_it_does_not_hold_for_is_refused():
    model = Distilled()
    with pytest.raises(ValueError, match="glass with the distribution GTR"):
        RoughDielectric(GTR(0.5, 1.5), Dielectric(1.5), model)
    with pytest.raises(ValueError, match=r"eta=.*must lie in \[0.333333, 3\]"):
        RoughDielectric(GGX(0.5), Dielectric(3.5), model)
