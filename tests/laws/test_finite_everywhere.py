"""Random rows, a share of them on edges: no value and no gradient is ever NaN or infinite."""

import math
from collections.abc import Iterable

import pytest
import torch
from cases import COMPENSATIONS, DISTRIBUTIONS, ELLIPTIC, SCATTERINGS, slow_if_heavy
from torch import Tensor

from torchms import RoughConductor, RoughDielectric, RoughDiffuse
from torchms.fresnel import Conductor, Dielectric, Schlick

MODELS = {**SCATTERINGS, **COMPENSATIONS}
MATERIALS = {
    # One in ten has k = 0, and η of glass is as often less than 1 as it is more.
    "conductor": lambda d, s, x: RoughConductor(
        d, Conductor(0.05 + 5 * x[:, :3], 8 * (x[:, 3:] - 0.1).clamp_min(0)), s
    ),
    "schlick": lambda d, s, x: RoughConductor(d, Schlick(x[:, :3]), s),
    "glass": lambda d, s, x: RoughDielectric(
        d, Dielectric(torch.exp(3 * x[:, 0] - 1.5 + 0.01 * (x[:, 0] - 0.5).sign())), s
    ),
    "diffuse": lambda d, s, x: RoughDiffuse(d, x[:, :3], s),
}
CHUNK = 20_000
ROWS = 10_000_000
"""Of the slow test, all pairs together."""

PAIRS = [
    (m, s)
    for m in MATERIALS
    for s in MODELS
    if not (m == "glass" and s.endswith("invariance")) and not (m in ("glass", "diffuse") and s in COMPENSATIONS)
]


def triples(distributions: Iterable[str]) -> pytest.MarkDecorator:
    """Parametrize over material, scattering and distribution; compensations have tables of the elliptic ones only."""
    cases = [(*pair, d) for pair in PAIRS for d in distributions if d in ELLIPTIC or pair[1] not in COMPENSATIONS]
    marked = [pytest.param(*c, id="-".join(c), marks=slow_if_heavy(c[1]) or slow_if_heavy(c[2])) for c in cases]
    return pytest.mark.parametrize("material,scattering,distribution", marked)


def edge_directions(n: int, generator: torch.Generator, dtype: torch.dtype) -> Tensor:
    """(n, 3) unit vectors over the sphere; a third of them at or next to a pole, the horizon or a coordinate plane."""
    u = torch.rand(n, 4, generator=generator, dtype=torch.float64)
    z = 2 * u[:, 0] - 1
    tiny = 10 ** (-9 * u[:, 3])
    kind = (u[:, 2] * 12).long()
    for k, value in enumerate((1 - tiny, tiny - 1, tiny, -tiny)):
        z = torch.where(kind == k, value, z)
    phi = torch.where(kind == 4, (4 * u[:, 1]).floor() / 4, u[:, 1]) * (2 * math.pi)
    r = ((1 - z) * (1 + z)).clamp_min(0).sqrt()
    w = torch.stack([r * phi.cos(), r * phi.sin(), z], -1)
    exact = torch.tensor([[0, 0, 1.0], [0, 0, -1], [1, 0, 0], [0, -1, 0]], dtype=torch.float64)
    pick = (u[:, 0] * 4).long().clamp_max(3)
    return torch.where((kind == 5)[:, None], exact[pick], w).to(dtype)


def chunk(material: str, scattering: str, distribution: str, n: int, generator: torch.Generator) -> list[str]:
    """What was not finite among n rows of forward, orders, albedo and walks, and their gradients, in float32."""
    wi, wo = (edge_directions(n, generator, torch.float32) for _ in range(2))
    other = torch.rand(n, 1, generator=generator) * 12
    for k, special in enumerate((wi, -wi, wi * torch.tensor([-1.0, -1.0, 1.0]), wi * torch.tensor([1.0, 1.0, -1.0]))):
        wo = torch.where(other.floor() == k, special, wo)
    # α over its whole range, evenly in its logarithm, the ends included.
    ax, ay = (1e-3 * 2000 ** (1.2 * torch.rand(n, generator=generator) - 0.1).clamp(0, 1) for _ in range(2))
    x = torch.rand(n, 6, generator=generator)
    leaves = {"wi": wi, "wo": wo, "alpha_x": ax.clamp(1e-3, 2), "alpha_y": ay.clamp(1e-3, 2), "numbers": x}
    leaves = {name: value.clone().requires_grad_() for name, value in leaves.items()}
    wi, wo, ax, ay, x = leaves.values()
    surface = MATERIALS[material](DISTRIBUTIONS[distribution](ax, ay), MODELS[scattering](3), x)
    u = surface.uniforms((n,), 1, generator=generator)
    flips = torch.rand(u.shape, generator=generator)
    u = torch.where(flips < 0.01, 0.0, torch.where(flips > 0.99, 1 - 2**-24, u))
    albedo, walk = surface.albedo(wi, u), surface.sample_walk(wi, u)
    outputs = {
        "orders": surface.orders(wi, wo, u),
        "albedo": albedo.reflected + albedo.transmitted,
        "walk": walk.weight[..., :1] * walk.wo,
        "pdf": surface.pdf(wi, wo),
    }
    bad = []
    for name, value in outputs.items():
        if not value.isfinite().all():
            bad.append(f"{name}: value")
        # A sum may overflow where no row does.
        found = torch.autograd.grad(value.sum(), list(leaves.values()), retain_graph=True, allow_unused=True)
        for leaf, gradient in zip(leaves, found, strict=True):
            if gradient is not None and not gradient.isfinite().all():
                row = int((~gradient.isfinite()).reshape(n, -1).any(1).nonzero()[0, 0])
                at = {k: v[row].tolist() for k, v in leaves.items() if k != "numbers"}
                bad.append(f"d {name} / d {leaf} at {at}")
    return bad


@triples(DISTRIBUTIONS)
def test_a_few_rows(material, scattering, distribution, generator):
    assert chunk(material, scattering, distribution, 2_000, generator) == []


@pytest.mark.slow
@triples(ELLIPTIC)
def test_ten_million_rows(material, scattering, distribution, generator):
    """In chunks; all materials, scatterings and distributions together."""
    for _ in range(math.ceil(ROWS / (2 * len(PAIRS) * CHUNK))):
        assert chunk(material, scattering, distribution, CHUNK, generator) == []
