"""Distilled lobes of diffuse facets: symmetries by construction, energies, and how close they are to the exact model."""

import math

import pytest
import torch
from cases import DISTILLATES, ELLIPTIC, TOLERANCES, bsdf, direction, directions, each
from test_distilled import turned
from test_energy import agreement
from test_finite import numbers, parameters, unfinished
from torch import Tensor

from torchms import BSDF, GTR, Bidirectional, Distilled, Invariance, RoughDiffuse, Stream, Unidirectional
from torchms.testing import reciprocity

ALPHAS = ((0.03,), (0.1,), (0.25,), (0.5,), (1.0,), (0.5, 0.15), (1.0, 0.1), (1.0, 0.3), (0.03, 1.0))
CELLS = [((0.25,), 0.5), ((0.5, 0.15), 1.0), ((0.5,), 1.4), ((1.0,), 0.5)]
ALBEDOS = (0.2, 0.8, 1.0)
every = [each("scattering", DISTILLATES), each("distribution", ELLIPTIC)]


def on_all(test):
    """Parametrize over distilled model × distribution."""
    for mark in every:
        test = mark(test)
    return test


@on_all
def test_reciprocity_and_the_symmetries_of_the_surface(scattering, distribution, generator):
    """Exchanged directions, mirrored axes, axes exchanged with their roughnesses: the same to rounding."""
    wi, wo = directions(300, generator, 0.01), directions(300, generator, 0.01)
    for alpha in ALPHAS:
        surface = bsdf("diffuse", scattering, distribution, alpha)
        there, back = reciprocity(surface, wi, wo)
        torch.testing.assert_close(there.mean, back.mean, rtol=1e-9, atol=1e-15)
        values = surface.orders(wi, wo)
        exchanged = bsdf("diffuse", scattering, distribution, alpha[::-1])
        for other, change in ((surface, {"x": -1.0}), (surface, {"y": -1.0}), (exchanged, {"swapped": True})):
            same = other.orders(turned(wi, **change), turned(wo, **change))
            torch.testing.assert_close(same, values, rtol=1e-9, atol=1e-12)


@on_all
def test_equal_roughnesses_are_isotropic(scattering, distribution, generator):
    """α_x = α_y given twice is α given once, and turning both directions about the normal changes nothing."""
    wi, wo = directions(200, generator, 0.01), directions(200, generator, 0.01)
    turn = torch.tensor([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    for alpha in (0.05, 0.4, 1.0):
        one, two = (bsdf("diffuse", scattering, distribution, given) for given in ((alpha,), (alpha, alpha)))
        torch.testing.assert_close(one.orders(wi, wo), two.orders(wi, wo), rtol=1e-9, atol=1e-12)
        torch.testing.assert_close(one.orders(wi, wo), one.orders(wi @ turn.T, wo @ turn.T), rtol=1e-8, atol=1e-10)


@on_all
def test_values_are_positive_and_the_sum_of_the_orders(scattering, distribution, generator):
    """Above the horizon; below it they are 0. No random numbers are asked for."""
    surface = bsdf("diffuse", scattering, distribution)
    wi, wo = directions(200, generator), directions(200, generator)
    orders = surface.orders(wi, wo)
    below = (wi[:, 2] <= 0) | (wo[:, 2] <= 0)
    assert orders.shape[-2] == surface.max_order == 4
    assert below.any() and (orders[below] == 0).all() and (orders[~below] > 0).all()
    torch.testing.assert_close(orders.sum(1), surface(wi, wo))


@on_all
def test_orders_scale_with_powers_of_the_albedo(scattering, distribution, generator):
    """Orders 1, 2 and 3 exactly; of all further ones together a share between 0 and the fourth power, which grows."""
    wi, wo = directions(100, generator, 0.01), directions(100, generator, 0.01)
    kind = ELLIPTIC[distribution](0.8, 0.4)
    albedos = (0.2, 0.5, 0.9, 1.0)
    *grey, white = (
        RoughDiffuse(kind, torch.tensor([albedo], dtype=torch.float64), Distilled()).double().orders(wi, wo)[..., 0]
        for albedo in albedos
    )
    shares = torch.zeros(100, dtype=torch.float64)
    for albedo, orders in zip(albedos, grey, strict=False):
        for k in (1, 2, 3):
            torch.testing.assert_close(orders[:, k - 1], white[:, k - 1] * albedo**k)
        now = orders[:, 3] / white[:, 3] / albedo**4
        assert (now >= shares).all() and (now <= 1 + 1e-12).all() and (now > shares).any()
        shares = now


@on_all
def test_the_furnace_is_white(scattering, distribution):
    """Albedo 1, by quadrature: to 1e-3 up to α = 0.5; to 3e-3 for α = 1 and axes of a ratio up to 10; to 5e-3 beyond."""
    off = {}
    z, weight = (torch.tensor(x) for x in gauss(24))
    turn = 2 * math.pi * (torch.arange(48, dtype=torch.float64) + 0.5) / 48
    r = (1 - z * z).sqrt()
    x, y = r[:, None] * turn.cos(), r[:, None] * turn.sin()
    wo = torch.stack(torch.broadcast_tensors(x, y, z[:, None]), -1).reshape(-1, 3)
    solid = (weight[:, None] * torch.full((48,), 2 * math.pi / 48, dtype=torch.float64)).reshape(-1)
    for alpha in ALPHAS:
        surface = bsdf("diffuse[white]", scattering, distribution, alpha)
        azimuths = (0.0, 0.8, 1.5) if len(alpha) == 2 else (0.8,)
        for theta in (0.0, 0.5, 1.0, 1.3):
            for phi in azimuths:
                value = surface(direction(theta, phi)[None], wo)[..., 0]
                off[alpha, theta, phi] = abs(float((value * solid).sum()) - 1) / furnace_bound(alpha)
    worst = max(off, key=lambda key: off[key])
    assert off[worst] < 1, (worst, off[worst] * furnace_bound(worst[0]))


def furnace_bound(alpha: tuple[float, ...]) -> float:
    """How white the furnace is."""
    if max(alpha) / min(alpha) > 10.1:
        return 5e-3
    return 1e-3 if len(alpha) == 1 and alpha[0] <= 0.5 else 3e-3


def gauss(n: int):
    """Nodes and weights on [0, 1]."""
    import numpy as np

    x, w = np.polynomial.legendre.leggauss(n)
    return (x + 1) / 2, w / 2


def lobe_error(distribution: str, alpha: tuple[float, ...], theta: float, points: int, walks: int, seed: int):
    """Squared error of the lobe over its square for each of `ALBEDOS`, and its standard error; without the noise's part."""
    surface = bsdf("diffuse[white]", "distilled", distribution, alpha, dtype=torch.float32)
    facets = surface.distribution
    walk = RoughDiffuse(facets, 1.0, Unidirectional(Invariance(), LONGEST))
    one = RoughDiffuse(facets, 1.0, Bidirectional(Invariance(), 1))
    generator = torch.Generator().manual_seed(seed)
    wi = direction(theta, 0.4, torch.float32).expand(points, 3)
    wo = directions(points, generator, 0.0, torch.float32)
    references = []
    for half in (0, 1):
        f = walk.orders(wi, wo, Stream(seed % 2**20 + half, walks))[..., 0]
        f[:, 0] = one(wi, wo, Stream(seed % 2**20 + 2 + half, 8 * walks))[:, 0]
        references.append(f)
    found = []
    for albedo in ALBEDOS:
        power = albedo ** torch.arange(1, LONGEST + 1)
        a, b = ((f * power).sum(-1) for f in references)
        mine = RoughDiffuse(facets, albedo, Distilled())(wi, wo)[:, 0]
        size = (a * b).mean()
        product = (mine - a) * (mine - b) / size
        found.append((float(product.mean()), float(product.std()) / math.sqrt(points)))
    return found


@on_all
@pytest.mark.parametrize("alpha,theta", CELLS)
def test_lobes_are_those_of_the_exact_model(alpha, theta, scattering, distribution, seed):
    """RMS of the lobe's error within 1 % of its RMS, by two references whose noise does not add to the error."""
    for error, spread in lobe_error(distribution, alpha, theta, 120, 320, seed):
        assert error < LOBE**2 + 4 * spread, (math.sqrt(max(error, 0)), spread)
        assert spread < LOBE**2, "the references are too noisy to judge"


LOBE = 0.01
LONGEST = 15


@pytest.mark.slow
@on_all
def test_half_of_the_lobes_are_within_half_a_percent(scattering, distribution, seed):
    """Over all roughnesses of the table, four angles and three albedos: the median, and the worst of all."""
    errors = []
    for alpha in ALPHAS[1:]:
        for theta in (0.0, 0.5, 1.0, 1.4):
            for error, spread in lobe_error(distribution, alpha, theta, 300, 800, seed):
                errors.append(math.sqrt(max(error, 0.0)))
                assert error < WORST**2 + 4 * spread, (alpha, theta, errors[-1])
    assert sorted(errors)[len(errors) // 2] < 0.005


WORST = 0.015


@on_all
def test_orders_walks_and_energies_agree(scattering, distribution, generator, seed, budget):
    """∫ orders = sample_walk = albedo, by order; and cell by cell, for the walks."""
    surface = bsdf("diffuse", scattering, distribution)
    budget(agreement(surface, direction(0.9), 40_000, generator, seed))


@on_all
def test_values_and_gradients_are_finite(scattering, distribution, generator):
    """At the pole, the horizon and beyond, at the ends of the range, in both precisions."""
    bad = {}
    for dtype in TOLERANCES:
        for alpha in ((0.03,), (0.3,), (1.0,), (1.0, 0.03)):
            surface = bsdf("diffuse", scattering, distribution, alpha, dtype=dtype)
            leaves = {name: x for name, x in parameters(surface).items() if "scattering" not in name}
            bad[dtype, alpha] = unfinished(surface, leaves, numbers(surface, dtype, generator)[:4])
    assert not any(bad.values()), bad


@on_all
def test_gradients_are_exact(scattering, distribution, generator):
    """d orders / d (α_x, α_y, albedo, directions): gradcheck in float64."""
    wi, wo = directions(3, generator, 0.2), directions(3, generator, 0.2)
    start = [torch.tensor(x, dtype=torch.float64) for x in (0.6, 0.35, [0.4, 0.9])]
    start = [x.requires_grad_() for x in (*start, wi, wo)]
    kind, model = ELLIPTIC[distribution], DISTILLATES[scattering](4).double()

    def matte(ax: Tensor, ay: Tensor, albedo: Tensor, i: Tensor, o: Tensor) -> Tensor:
        unit = [torch.nn.functional.normalize(w, dim=-1) for w in (i, o)]
        return RoughDiffuse(kind(ax, ay), albedo, model).orders(*unit)

    assert torch.autograd.gradcheck(matte, start, eps=1e-6, atol=1e-6, rtol=1e-4)


@on_all
def test_maps_of_alpha_are_pixels(scattering, distribution, generator):
    """A per-pixel map gives what each pixel gives alone."""
    kind, model = ELLIPTIC[distribution], DISTILLATES[scattering](4)
    wi, wo = directions(4, generator, 0.2).float(), directions(4, generator, 0.2).float()
    ax, ay = torch.tensor([0.1, 0.4, 0.8, 1.0]), torch.tensor([0.3, 0.1, 0.8, 0.2])

    def matte(x: Tensor, y: Tensor) -> BSDF:
        return RoughDiffuse(kind(x, y), [0.3, 0.9], model)

    one_by_one = torch.stack([matte(ax[i], ay[i])(wi[i], wo[i]) for i in range(4)])
    torch.testing.assert_close(matte(ax, ay)(wi, wo), one_by_one, rtol=1e-4, atol=1e-6)


@pytest.mark.usefixtures("messages")
def test_what_it_does_not_hold_for_is_refused():
    with pytest.raises(ValueError, match="diffuse with the distribution GTR"):
        RoughDiffuse(GTR(0.5, 1.5), 0.5, Distilled())
