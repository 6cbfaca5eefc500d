"""The public surface of a BSDF: what it refuses, with which words, and what it returns at the edges of its domain."""

import math
from functools import partial
from importlib import import_module

import pytest
import torch
from cases import MATERIALS, SCATTERINGS, bsdf, direction, directions, each, models, serves, transmits

from torchms import (
    GGX,
    GTR,
    Beckmann,
    Correlated,
    Distilled,
    HeightWalk,
    Invariance,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Uncorrelated,
    Unidirectional,
)
from torchms.fresnel import Conductor, Dielectric, Ideal

UP = torch.tensor([[0.0, 0.0, 1.0]])


def walked() -> RoughConductor:
    return RoughConductor(GGX(0.5), Ideal(), Unidirectional(Uncorrelated(), 2))


BAD_INPUT = {
    # α: name, value (and its index), range, remedy
    "alpha zero": (lambda: GGX(0.0), ValueError, r"GGX\(alpha=\.\.\.\).*\[0\.001, 2\]; got 0\. .*take 0\.001"),
    "alpha negative": (lambda: Beckmann(-0.1), ValueError, r"Beckmann\(alpha=\.\.\.\).*got -0\.1"),
    "alpha NaN": (lambda: GGX(math.nan), ValueError, r"GGX\(alpha=\.\.\.\).*got nan"),
    "alpha in a map": (
        lambda: GGX(torch.tensor([[0.1, 0.2], [0.3, 0.0]])),
        ValueError,
        r"alpha=\.\.\.\).*got 0 at index \(1, 1\)",
    ),
    "alpha_y": (lambda: GGX(0.5, 3.0), ValueError, r"GGX\(alpha_y=\.\.\.\).*\[0\.001, 2\]; got 3"),
    "alpha a word": (lambda: GGX("rough"), TypeError, r"alpha=\.\.\.\) must be a float, a Tensor.*got str"),
    # Fresnel
    "eta of glass": (lambda: Dielectric(0.0), ValueError, r"Dielectric\(eta=\.\.\.\).*got 0.*n_inside / n_outside"),
    "eta of glass NaN": (lambda: Dielectric(math.nan), ValueError, r"eta=\.\.\.\).*got nan"),
    "eta of metal": (lambda: Conductor(-0.2, 3.0), ValueError, r"Conductor\(eta=\.\.\.\).*got -0\.2"),
    "k of metal": (lambda: Conductor(0.2, -1.0), ValueError, r"Conductor\(k=\.\.\.\).*\[0, .*got -1"),
    "metal": (lambda: Conductor.metal("unobtainium"), ValueError, r"'unobtainium'.*Known: Ag.*Au.*W"),
    "no interface": (
        lambda: RoughDielectric(GGX(0.5), Dielectric(1.0)),
        ValueError,
        r"eta must differ from 1.*got 1.*no interface",
    ),
    # Slots
    "distribution": (lambda: RoughConductor(0.5, Ideal()), TypeError, r"distribution=\.\.\.\) must be GGX.*got 0\.5"),
    "fresnel": (lambda: RoughConductor(GGX(0.5), 1.5), TypeError, r"fresnel=\.\.\.\).*Conductor\.metal.*got 1\.5"),
    "fresnel of glass": (
        lambda: RoughDielectric(GGX(0.5), Ideal()),
        TypeError,
        r"must be .*Dielectric\(1\.5\); got Ideal",
    ),
    "scattering": (
        lambda: RoughConductor(GGX(0.5), Ideal(), Invariance()),
        TypeError,
        r"scattering=\.\.\.\) must be HeightWalk.*got Invariance\(\)\. Write Bidirectional\(Invariance\(\)\)",
    ),
    "scattering without brackets": (
        lambda: RoughConductor(GGX(0.5), Ideal(), HeightWalk),
        TypeError,
        r"must be HeightWalk.*got <class .* Write HeightWalk\(\), with the brackets",
    ),
    "segment": (lambda: Unidirectional("invariance"), TypeError, r"segment=\.\.\.\) must be .*got 'invariance'"),
    "mode": (
        lambda: RoughDielectric(GGX(0.5), Dielectric(1.5), mode="photon"),
        ValueError,
        r"mode=\.\.\.\) must be one of radiance, importance; got 'photon'",
    ),
    "albedo": (
        lambda: RoughDiffuse(GGX(0.5), [0.5, 1.2]),
        ValueError,
        r"RoughDiffuse\(albedo=\.\.\.\).*\[0, 1\]; got 1\.2 at index \(1,\).*cannot reflect more",
    ),
    "invariance in glass": (
        lambda: RoughDielectric(GGX(0.5), Dielectric(1.5), Unidirectional(Invariance())),
        ValueError,
        r"Invariance\(\).*one side.*HeightWalk\(\).*Unidirectional\(Correlated\(\)\)",
    ),
    "no order": (lambda: HeightWalk(0), ValueError, r"HeightWalk\(max_order=\.\.\.\).*\[1, 256\]; got 0.*SingleBounce"),
    "too many orders": (lambda: Unidirectional(Correlated(), 1000), ValueError, r"max_order=\.\.\.\).*got 1000"),
    "half an order": (
        lambda: Unidirectional(Correlated(), 2.5),
        TypeError,
        r"max_order=\.\.\.\) must be an int; got 2\.5",
    ),
    # Arguments
    "wi of two": (
        lambda: walked().pdf(torch.zeros(4, 2), UP),
        ValueError,
        r"wi must be \(\*batch, 3\).*got shape \(4, 2\)\. Angles theta and phi \[rad\] are",
    ),
    "wo of two": (
        lambda: walked().pdf(UP, torch.zeros(4, 2)),
        ValueError,
        r"wo must be \(\*batch, 3\).*got shape \(4, 2\)",
    ),
    "wi a list": (lambda: walked().pdf([0, 0, 1], UP), TypeError, r"wi must be a floating-point Tensor.*got list"),
    "wi of integers": (lambda: walked().pdf(UP.long(), UP), TypeError, r"wi must be.*int64\. Write \.float\(\)"),
    "wi an angle": (lambda: walked().pdf(0.5, UP), TypeError, r"wi must be .*got float\. Angles theta and phi"),
    "wo missing": (lambda: walked().pdf(UP, None), TypeError, r"wo must be a floating-point Tensor"),
    "batches": (
        lambda: walked()(UP.expand(4, 3), UP.expand(5, 3), walked().uniforms((4,))),
        ValueError,
        r"do not broadcast: wi \(4,\), wo \(5,\), u \(4,\)",
    ),
    "batch of a parameter": (
        lambda: RoughConductor(GGX(torch.full((7,), 0.5)), Ideal()).pdf(UP.expand(4, 3), UP),
        ValueError,
        r"do not broadcast: wi \(4,\), wo \(1,\); parameters \[\(7,\)\]",
    ),
    "u missing": (
        lambda: walked()(UP, UP),
        ValueError,
        r"forward\(\) needs random numbers: u is missing.*bsdf\.uniforms",
    ),
    "u of the wrong D": (
        lambda: walked().sample(UP, torch.zeros(1, 2, 3)),
        ValueError,
        r"u must be \(\*batch, N, D\) with N >= 1 and D = 5.*got shape \(1, 2, 3\).*bsdf\.uniforms",
    ),
    "u without paths": (
        lambda: walked().albedo(UP, torch.zeros(1, 0, 5)),
        ValueError,
        r"N >= 1.*got shape \(1, 0, 5\)",
    ),
    "u a number": (
        lambda: walked().sample_walk(UP, 0.5),
        TypeError,
        r"u must be .* a floating-point Tensor.*got float",
    ),
}


@pytest.mark.usefixtures("messages")
@each("case", BAD_INPUT)
def test_bad_input(case):
    """Name, value, allowed range and remedy."""
    call, error, message = BAD_INPUT[case]
    with pytest.raises(error, match=r"(?s)" + message):
        call()


@each("material", MATERIALS)
def test_invariance_serves_one_side(material):
    for scattering in SCATTERINGS:
        assert serves(material, scattering) == (not transmits(material) or not scattering.endswith("invariance"))


@models()
def test_forward_is_the_sum_of_the_orders(material, scattering, generator):
    surface = bsdf(material, scattering)
    wi, wo = directions(50, generator), directions(50, generator)
    u = surface.uniforms((50,), 2, generator=generator)
    orders = surface.orders(wi, wo, u)
    assert orders.shape == (50, surface.max_order, surface.n_channels)
    assert (orders >= 0).all()
    torch.testing.assert_close(surface(wi, wo, u), orders.sum(-2))


@models(m for m in MATERIALS if not transmits(m))
def test_nothing_below_the_horizon(material, scattering, generator):
    """A reflecting surface is black from below and to below; `sample` stays above, and has pdf 0 for a wi from below."""
    surface = bsdf(material, scattering)
    up, down = directions(20, generator, 0.01), -directions(20, generator, 0.01)
    u = surface.uniforms((20,), 3, generator=generator)
    for wi, wo in ((up, down), (down, up), (down, down)):
        assert (surface(wi, wo, u) == 0).all() and (surface.pdf(wi, wo) == 0).all()
    assert (surface.sample(up, u).wo[..., 2] > 0).all() and (surface.sample(down, u).pdf == 0).all()
    assert (surface.sample_walk(down, u).weight == 0).all()
    walk = surface.sample_walk(up, u)
    assert (walk.wo[..., 2] > 0)[walk.order > 0].all()
    assert (walk.weight[walk.order == 0] == 0).all() and (walk.order <= surface.max_order).all()
    assert all((energy == 0).all() for energy in surface.albedo(down, u))


@models()
def test_samples_are_unit(material, scattering, generator):
    surface = bsdf(material, scattering)
    u = surface.uniforms((20,), 50, generator=generator)
    wi = directions(20, generator)
    for wo in (surface.sample(wi, u).wo, surface.sample_walk(wi, u).wo):
        torch.testing.assert_close(wo.norm(dim=-1), torch.ones(20, 50, dtype=torch.float64))


def test_deterministic_values_need_no_numbers():
    """SingleBounce with mirrors or glass; it takes them where they are given and does not look at them."""
    wi, wo = direction(0.5), direction(1.0)
    for material in ("conductor[conductor]", "dielectric"):
        surface = bsdf(material, "single")
        assert surface.scattering.is_deterministic(surface.vertex)
        assert torch.equal(surface(wi, wo), surface(wi, wo, surface.uniforms(())))
    assert not SingleBounce().is_deterministic(bsdf("diffuse", "single").vertex)


def test_defaults():
    """Metal and chalk without noise where lobes were distilled; elsewhere the exact model of each material, eight orders."""
    for material in (partial(RoughConductor, fresnel=Ideal()), partial(RoughDiffuse, albedo=0.5)):
        assert isinstance(material(Beckmann(0.5, 0.03)).scattering, Distilled)
        for elsewhere in (GTR(0.5, 2.0), GGX(torch.tensor([0.5, 1.2]))):
            surface = material(elsewhere)
            assert isinstance(surface.scattering.segment, Invariance) and surface.max_order == 8
    glass = RoughDielectric(GGX(0.5), Dielectric(1.5))
    assert isinstance(glass.scattering, HeightWalk) and glass.mode == "radiance" and glass.max_order == 8


def test_isotropic_is_the_limit(generator):
    """α_y = α_x is the same surface as one α."""
    wi, wo = directions(50, generator, 0.05), directions(50, generator, 0.05)
    one, two = (
        bsdf("conductor[conductor]", "single", alpha=(0.4,)),
        bsdf("conductor[conductor]", "single", alpha=(0.4, 0.4)),
    )
    torch.testing.assert_close(one(wi, wo), two(wi, wo), rtol=1e-12, atol=0)


def test_a_rotated_surface_is_the_same(generator):
    """Turning wi and wo by 90° swaps α_x and α_y."""
    wi, wo = directions(50, generator, 0.05), directions(50, generator, 0.05)
    turn = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=torch.float64)
    for material in ("conductor[conductor]", "dielectric"):
        one, two = (bsdf(material, "single", alpha=alpha) for alpha in ((0.7, 0.2), (0.2, 0.7)))
        torch.testing.assert_close(one(wi, wo), two(wi @ turn.T, wo @ turn.T), rtol=1e-10, atol=1e-15)


def test_the_namespace_is_what_it_says():
    package = import_module("torchms")
    for name in package.__all__:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Specular'"):
        _ = package.Specular
    with pytest.raises(AttributeError, match=r"no attribute 'Conductor'; it is torchms\.fresnel\.Conductor$"):
        _ = package.Conductor
