"""The second order is the path integral, done without random numbers: ∫ v(wi, d) v(−d, wo) S(−wi, d, wo) dd."""

import pytest
import torch
from cases import DISTRIBUTIONS, SEGMENTS, bsdf, directions, each
from torch import Tensor

from torchms import BSDF, Segment
from torchms.maths.frame import Vec3, split
from torchms.testing import estimate, exactly, p_value, sphere_cells, zscore

MIRRORS = ("conductor[ideal]", "conductor[schlick]")


def second_order(surface: BSDF, segment: Segment, wi: Tensor, wo: Tensor) -> Tensor:
    """f · |cos θ_o| of order 2, of the last channel, from the vertex terms and the plain segment term."""
    vertex, Lambda = surface.vertex, surface.distribution.Lambda

    def integrand(d: Tensor) -> Tensor:
        first, last = (Vec3(*w.expand(len(d), 3).unbind(-1)) for w in (wi, wo))
        between = segment(torch.stack(torch.broadcast_tensors(Lambda(-wi), Lambda(d), Lambda(wo)), -1))
        return (vertex.value(first, split(d), None, None) * vertex.value(-split(d), last, None, None))[-1] * between

    return sphere_cells(integrand, (8, 16), 1e-5, levels=7).sum()


@each("material", MIRRORS)
@each("distribution", DISTRIBUTIONS)
@each("segment", SEGMENTS)
def test_second_order_is_the_integral(material, distribution, segment, generator, budget):
    surface = bsdf(material, segment, distribution, (1.0, 0.4), max_order=2)
    wi, wo = directions(4, generator, 0.2), directions(4, generator, 0.2)
    u = surface.uniforms((4, 20_000), 1, generator=generator)
    ours = estimate(surface.orders(wi[:, None], wo[:, None], u)[..., 1, -1], dim=1)
    truth = torch.stack([second_order(surface, SEGMENTS[segment](), *pair) for pair in zip(wi, wo, strict=True)])
    budget(p_value(zscore(ours, exactly(truth), rounding=1e-5)))


@each("distribution", DISTRIBUTIONS)
@each("segment", SEGMENTS)
def test_second_order_is_reciprocal(distribution, segment, generator):
    """To the quadrature's error; Correlated is off by a percent or more."""
    surface = bsdf("conductor[schlick]", segment, distribution, (1.0, 0.4))
    off = []
    for wi, wo in zip(directions(3, generator, 0.4), directions(3, generator, 0.4), strict=True):
        there, back = (second_order(surface, SEGMENTS[segment](), *way) for way in ((wi, wo), (wo, wi)))
        off.append(float(back * wo[2] / (there * wi[2])) - 1)
    if SEGMENTS[segment].is_reciprocal:
        assert off == pytest.approx([0, 0, 0], abs=1e-3)
    else:
        assert max(map(abs, off)) > 0.01
