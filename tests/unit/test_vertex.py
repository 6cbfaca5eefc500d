"""What one facet does to light, against its definition."""

import math

import pytest
import torch
from cases import DISTRIBUTIONS, bsdf, direction, directions, each, sides, slow_if_heavy
from torch import Tensor

from torchms import RoughConductor
from torchms.maths.frame import Vec3, split
from torchms.paths.refractive import Refractive
from torchms.testing import chi_square, estimate, exactly, p_value, sphere_cells, zscore

VERTICES = {"conductor": "conductor[ideal]", "dielectric": "dielectric", "diffuse": "diffuse[white]"}
DEAR = ("beckmann", "diffuse")
VIEWS = {"above": 0.6, "grazing": 1.5, "below": 2.2}


def at(w: Tensor, n: int) -> Vec3:
    """The same direction n times, as components."""
    return Vec3(*w.expand(n, 3).unbind(-1))


FACETS = [
    pytest.param(
        distribution,
        vertex,
        # A sum over 256 normals, as for GGX, each by Newton's method.
        marks=[*slow_if_heavy(distribution), *([pytest.mark.slow] if (distribution, vertex) == DEAR else [])],
    )
    for distribution in DISTRIBUTIONS
    for vertex in VERTICES
]


@pytest.mark.parametrize("distribution,vertex", FACETS)
@each("view", VIEWS)
def test_density_is_that_of_the_samples(vertex, distribution, view, generator, budget):
    """From either side of the horizon: `density` integrates to 1 and `sample` follows it (chi²); weights are the albedo."""
    model = bsdf(VERTICES[vertex], "single", distribution).vertex
    w, n = direction(VIEWS[view]), 20_000
    # A diffuse density is a sum over 256 normals, which is slow, and smooth.
    resolution = ((6, 8), 1e-2) if vertex == "diffuse" else ((16, 32), 1e-4)
    p = []
    for sign in sides(VERTICES[vertex]):
        side = torch.full((n,), sign, dtype=torch.float64) if model.transmits else None
        u = torch.rand(model.n_uniforms, n, generator=generator, dtype=torch.float64)
        bounce = model.sample(at(w, n), model.visible_normal(at(w, n), u[0], u[1]), tuple(u[2:]), side)
        torch.testing.assert_close(bounce.weight, torch.ones_like(bounce.weight))
        d = torch.stack(torch.broadcast_tensors(*bounce.d), -1)
        crossed = model.crossed(side, bounce.side)
        if crossed is None:
            p.append(chi_square(d, lambda x: model.density(at(w, len(x)), split(x), None), *resolution))
            continue
        assert isinstance(model, Refractive)
        for transmitted in (False, True):
            # Of what is transmitted, `d` is in the frame of the new side, and the density in the frame of the old one.
            chosen = crossed == transmitted
            fold = -1.0 if transmitted else 1.0

            def density(x: Tensor, transmitted=transmitted, sign=sign) -> Tensor:
                here = torch.full((len(x),), sign, dtype=torch.float64)
                return model.transport_density(at(w, len(x)), split(x), here, torch.full((len(x),), transmitted))

            share = float(sphere_cells(density, *resolution).sum())
            p.append(float(p_value(zscore(estimate(chosen.double()), exactly(torch.tensor(share)), rounding=1e-3))))
            if share > 0.2:  # its error is that of the quadrature over the share
                p.append(chi_square(fold * d[chosen], lambda x, f=density, s=share: f(x) / s, *resolution))
    budget(p)


@each("distribution", DISTRIBUTIONS)
def test_mirror_is_the_formula(distribution, generator):
    """F(w·h) D(h) / (4 |w_z|), symmetric but for |w_z| on the whole sphere, zero where h points down."""
    surface = bsdf("conductor[schlick]", "single", distribution)
    w, d = directions(500, generator), directions(500, generator)
    assert isinstance(surface, RoughConductor)
    value = surface.vertex.value(split(w), split(d))
    h = torch.nn.functional.normalize(w + d, dim=-1)
    expected = surface.fresnel((w * h).sum(-1)).T * surface.distribution.D(h) / (4 * w[:, 2].abs())
    # Far below the horizon a(w) is lost, and with it the vertex term that is divided by it.
    kept = surface.distribution.Lambda(-w).abs() * w[:, 2].abs() > 1e-70
    torch.testing.assert_close(value[:, kept], expected[:, kept], rtol=1e-8, atol=1e-200)
    assert (value[:, h[:, 2] < 0] == 0).all()


@each("distribution", DISTRIBUTIONS)
def test_refraction_is_symmetric_up_to_eta_squared(distribution, generator):
    """|w_z| v(w, d) n_w² = |d_z| v(d, w) n_d² for both ways, sides and signs of the horizon."""
    model = bsdf("dielectric", "single", distribution, (0.9, 0.6)).vertex
    assert isinstance(model, Refractive)
    w, d = split(directions(2000, generator)), split(directions(2000, generator))
    area = model.distribution.guarded_area
    outside, inside = torch.ones_like(w.z), -torch.ones_like(w.z)
    for transmitted in (False, True):
        mask = torch.full(w.z.shape, transmitted)
        there = model.transport_density(w, d, outside, mask) * area(w)
        back = (
            model.transport_density(-d, -w, inside, mask) * area(-d) * 1.5**2
            if transmitted
            else (model.transport_density(d, w, outside, mask) * area(d))
        )
        assert (there > 0).double().mean() > 0.01
        torch.testing.assert_close(there, back, rtol=1e-8, atol=1e-14)


@each("distribution", DISTRIBUTIONS)
def test_diffuse_phase_is_an_estimate_of_its_density(distribution, generator, budget):
    """(ρ/π) ⟨d, m⟩ over visible normals m has the mean ∫ ⟨d, m⟩ D_w(m) dm / π."""
    model = bsdf("diffuse[white]", "single", distribution).vertex
    w, d = directions(6, generator), directions(6, generator)
    u = torch.rand(2, 20_000, 6, generator=generator, dtype=torch.float64)
    phase = model.phase(split(w), split(d), model.visible_normal(split(w), u[0], u[1]), None)[0]
    truth = []
    for one, other in zip(w, d, strict=True):
        truth.append(
            sphere_cells(
                lambda m: model.distribution.D_visible(one, m) * (m @ other).clamp_min(0), (16, 16), 1e-6
            ).sum()
        )
    budget(p_value(zscore(estimate(phase), exactly(torch.stack(truth) / math.pi), rounding=1e-5)))


def test_total_reflection_transmits_nothing(generator):
    """From inside beyond the critical angle, asin(1 / 1.5), every facet reflects. (GGX would have a few steep ones.)"""
    model = bsdf("dielectric", "single", "beckmann", (1e-3,)).vertex
    n = 1000
    w, inside = at(direction(math.asin(1 / 1.5) + 0.02), n), -torch.ones(n, dtype=torch.float64)
    u = torch.rand(3, n, generator=generator, dtype=torch.float64)
    bounce = model.sample(w, model.visible_normal(w, u[0], u[1]), (u[2],), inside)
    assert (bounce.side == -1).all()
    assert pytest.approx(1) == float(bounce.weight.mean())
