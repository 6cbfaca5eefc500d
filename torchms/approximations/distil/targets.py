"""What a distillation learns from: noisy, unbiased estimates of each order, of its facets and of the tail's length."""

import torch
from torch import Tensor

from torchms.approximations.distil.rows import KINDS, Rows
from torchms.approximations.facet_reflectance import MEANS, shapes
from torchms.bsdfs import RoughConductor
from torchms.bsdfs.compile import compile
from torchms.estimators import Bidirectional, Scattering, Unidirectional
from torchms.fresnel import Ideal
from torchms.fresnel.base import Fresnel
from torchms.paths.segments import Invariance
from torchms.sampling.stream import Stream

DELTA = 0.01
LONGEST = 14
"""Most bounces: 6e-5 of the light bounces more often off GGX with α = 1, F = 1."""
COLUMNS = 5 + 3 * MEANS
"""f of the orders 1, 2, 3 and ≥ 4 [1/sr]; Σ k f_k of the last; then, of the orders 2, 3 and ≥ 4, f_k times the sums over a
path's facets of the three `shapes` of their cosines, and over pairs of facets of the first shape at both."""


class _Probe(Fresnel):
    """Reflectances near 1 whose variation shows how a path's facets are met, 8 channels: 1 ± δ times each of the `shapes`,
    and 1 ± the first of them."""

    delta: Tensor

    def __init__(self, delta: float) -> None:
        super().__init__()
        self.declare("delta", delta, low=0.0, high=1.0, remedy="It is a small number.")

    @property
    def n_channels(self) -> int:
        return 8

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        found = shapes(cos_theta.abs())
        parts = [self.delta * x for x in found] + [found[0]]
        return torch.stack([1 + x for x in parts] + [1 - x for x in parts])


@torch.no_grad()
def estimated(kind: str, rows: Rows, seed: int, n_paths: tuple[int, int]) -> Tensor:
    """Estimates (n, COLUMNS): `n_paths` bidirectional ones for two and three bounces, and walks for the longer.

    Derivatives by δ are differences of two estimates with the same random numbers.
    """
    short, facets = _parts(kind, rows, Bidirectional(Invariance(), 3), Stream(seed, n_paths[0]))
    long, more = _parts(kind, rows, Unidirectional(Invariance(), LONGEST), Stream(seed + 1, n_paths[1]))
    tail = long[:, 3:]
    k = torch.arange(4, LONGEST + 1, dtype=tail.dtype)
    columns = torch.cat([short, torch.stack([tail.sum(-1), (tail * k).sum(-1)], -1)], 1)
    return torch.cat([columns, facets[:, 1], facets[:, 2], more[:, 3:].sum(1)], 1)


@torch.no_grad()
def orders(kind: str, rows: Rows, seed: int, n_paths: tuple[int, int]) -> Tensor:
    """Estimates (n, 4) of f of the orders 1, 2, 3 and ≥ 4 [1/sr] with F = 1; eager, for a few rows."""
    models = Bidirectional(Invariance(), 3), Unidirectional(Invariance(), LONGEST)
    short, long = (
        RoughConductor(KINDS[kind](rows.ax, rows.ay), Ideal(), model).orders(rows.wi, rows.wo, Stream(seed + i, n))
        for i, (model, n) in enumerate(zip(models, n_paths, strict=True))
    )
    return torch.cat([short[..., 0], long[:, 3:, 0].sum(-1, keepdim=True)], -1) / rows.wo[:, 2:]


def _parts(kind: str, rows: Rows, scattering: Scattering, u: Stream) -> tuple[Tensor, Tensor]:
    """Means of the orders (n, K), and what their facets and pairs of facets add up to (n, K, MEANS)."""
    surface = compile(RoughConductor(KINDS[kind](rows.ax, rows.ay), _Probe(DELTA), scattering), verbose=False)
    up, down = (surface.orders(rows.wi, rows.wo, u) / rows.wo[:, 2:, None]).unflatten(-1, (2, MEANS)).unbind(-2)
    mean = (up + down)[..., :3].mean(-1) / 2
    # 1 ± x: of even powers the second is what pairs give, up to those of four facets.
    pairs = (up + down)[..., 3] / 2 - mean
    return mean, torch.cat([(up - down)[..., :3] / (2 * DELTA), pairs[..., None]], -1)
