"""What `sample` returned goes into `forward`, `orders` and `pdf` as it is."""

import pytest
import torch
from cases import bsdf, directions, each

import torchms
from torchms import GGX, KullaConty, RoughConductor, SingleBounce, Stream
from torchms.fresnel import Schlick

SURFACES = {
    "conductor": lambda: bsdf("conductor[conductor]", "single"),
    "dielectric": lambda: bsdf("dielectric", "single"),
    "diffuse": lambda: bsdf("diffuse", "distilled"),
}


@each("name", SURFACES)
@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_one_value_for_each_direction(name, batch, generator):
    surface = SURFACES[name]()
    wi = directions(6, generator, 0.1)[: max(1, torch.Size(batch).numel())].reshape(*batch, 3)
    drawn = surface.sample(wi, Stream(3, 5))
    value, orders, pdf = surface(wi, drawn), surface.orders(wi, drawn), surface.pdf(wi, drawn)
    pairs = wi.unsqueeze(-2).expand(*batch, 5, 3)
    assert value.shape == (*batch, 5, surface.n_channels) and orders.shape == (
        *batch,
        5,
        surface.max_order,
        surface.n_channels,
    )
    torch.testing.assert_close(value, surface(pairs, drawn.wo))
    torch.testing.assert_close(orders, surface.orders(pairs, drawn.wo))
    torch.testing.assert_close(pdf, drawn.pdf)


def test_maps_line_up(generator):
    """A roughness of each row stays with its row, also in as many rows as there are directions."""
    wi, alpha = directions(5, generator, 0.2), 0.1 + 0.8 * torch.rand(5, generator=generator, dtype=torch.float64)
    f0 = torch.rand(5, 3, generator=generator, dtype=torch.float64)
    surface = RoughConductor(GGX(alpha), Schlick(f0), KullaConty())
    drawn = surface.sample(wi, Stream(3, 5))
    value = surface(wi, drawn)
    for k in range(5):
        alone = RoughConductor(GGX(alpha[k]), Schlick(f0[k]), KullaConty())
        torch.testing.assert_close(value[k], alone(wi[k].expand(5, 3), drawn.wo[k]))


def test_random_values(generator, budget):
    """Values that are drawn: each direction has numbers of its own, and the mean over all is the energy."""
    surface = bsdf("conductor[ideal]", "invariance", max_order=3)
    wi = directions(1, generator, 0.5)[0]
    drawn = surface.sample(wi, Stream(1, 1 << 13))
    ratio = surface(wi, drawn, Stream(2))[:, 0] / drawn.pdf
    walks = surface.albedo(wi.expand(1 << 13, 3), Stream(3)).reflected.sum(-2)[:, 0]
    z = (ratio.mean() - walks.mean()) / ((ratio.var() + walks.var()) / len(ratio)).sqrt()
    budget(2 * torch.distributions.Normal(0.0, 1.0).cdf(-z.abs()))


def test_compiled_too(generator):
    surface = RoughConductor(GGX(0.4), Schlick([0.5]), SingleBounce())
    fast, wi = torchms.compile(surface, verbose=False), directions(4, generator, 0.2, torch.float32)
    drawn = surface.sample(wi, Stream(3, 5))
    for _ in range(2):
        torch.testing.assert_close(fast(wi, drawn), surface(wi, drawn), rtol=1e-4, atol=1e-6)
