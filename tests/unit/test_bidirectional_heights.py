"""Walks from both ends that draw their heights: glass order by order against walks from one end."""

import math

import pytest
import torch
from cases import ELLIPTIC, directions

from torchms import Bidirectional, HeightWalk, RoughConductor, RoughDielectric, Stream
from torchms.fresnel import Dielectric, Ideal
from torchms.paths.height import RandomHeight
from torchms.testing import p_value

PAIRS = 4


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("eta", [1.5, 1 / 1.3])
def test_glass_by_walks_from_both_ends(eta, distribution, generator, seed, budget):
    """Means of each order are those of the height walk, on either side of the surface."""
    surface = RoughDielectric(ELLIPTIC[distribution](0.8, 0.4), Dielectric(eta), HeightWalk(4)).double()
    joined = RoughDielectric(surface.distribution, surface.fresnel, Bidirectional(RandomHeight(), 4)).double()
    budget(agreement(surface, joined, generator, seed, either_side=True))


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_metal_by_walks_from_both_ends(distribution, generator, seed, budget):
    """The same for mirrors, which no ray passes."""
    surface = RoughConductor(ELLIPTIC[distribution](0.8, 0.4), Ideal(), HeightWalk(4)).double()
    joined = RoughConductor(surface.distribution, Ideal(), Bidirectional(RandomHeight(), 4)).double()
    budget(agreement(surface, joined, generator, seed, either_side=False))


def agreement(one, other, generator: torch.Generator, seed: int, *, either_side: bool) -> torch.Tensor:
    """p-values of the differences of the orders from 2 on, over a few pairs of directions."""
    wi, wo = directions(PAIRS, generator, 0.1), directions(PAIRS, generator, 0.1)
    if either_side:
        wo = wo * torch.tensor([[1.0], [-1.0]], dtype=wo.dtype).repeat(PAIRS // 2, 1)
    found = []
    for surface, copies, paths in ((one, 64, 1024), (other, 64, 64)):
        many = [w.repeat(copies, 1) for w in (wi, wo)]
        values = surface.orders(*many, Stream(seed % 2**20, paths))[..., 1:, 0].reshape(copies, PAIRS, -1)
        found.append((values.mean(0), values.std(0) / math.sqrt(copies)))
    (a, spread_a), (b, spread_b) = found
    return p_value((a - b) / torch.hypot(spread_a, spread_b)).flatten()


def test_its_noise_is_far_below_that_of_the_height_walk(generator, seed):
    """Reflection beside a lobe of glass of low index, which walks from one end hardly ever find: less than half."""
    spreads = []
    for scattering in (HeightWalk(4), Bidirectional(RandomHeight(), 4)):
        surface = RoughDielectric(ELLIPTIC["ggx"](0.8), Dielectric(1.1), scattering)
        wi, wo = (directions(64, generator, 0.3).float() for _ in range(2))
        generator.manual_seed(seed)
        values = torch.stack([surface.orders(wi, wo, Stream(k, 64))[:, 1:, 0].sum(1) for k in range(8)])
        spreads.append(float(values.std(0).mean()))
    # Few of the height walk's paths carry most of its variance, so that a short run shows only a part of it.
    assert spreads[1] < 0.5 * spreads[0], spreads
