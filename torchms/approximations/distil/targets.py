"""What a distillation learns from: noisy, unbiased estimates of each order, of its facet cosines and of the tail's length."""

import torch
from torch import Tensor

from torchms.approximations.distil.rows import KINDS, Rows
from torchms.bsdfs import RoughConductor
from torchms.bsdfs.compile import compile
from torchms.estimators import Bidirectional, Scattering, Unidirectional
from torchms.fresnel import Ideal
from torchms.fresnel.base import Fresnel
from torchms.parameters.declared import channels_first
from torchms.paths.segments import Invariance
from torchms.sampling.stream import Stream

DELTA = 0.01
LONGEST = 14
"""Most bounces: 6e-5 of the light bounces more often off GGX with α = 1, F = 1."""
COLUMNS = ("f1", "f2", "f3", "f4", "kf4", "s2", "s3", "s4")
"""f of the orders 1, 2, 3 and ≥ 4 [1/sr]; Σ k f_k of the last; f_k ⟨Σ_l (1 − c_l)⁵⟩ of the orders 2, 3 and ≥ 4."""


class _Probe(Fresnel):
    """1 + δ (1 − cos θ)⁵: a reflectance whose variation shows how a path's facets are met."""

    delta: Tensor

    def __init__(self, delta: float) -> None:
        super().__init__()
        self.declare("delta", delta, low=-1.0, high=1.0, channels=True, remedy="It is a small number.")

    @property
    def n_channels(self) -> int:
        return 1

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        x = 1 - cos_theta.abs()
        x2 = x * x
        return 1 + channels_first(self.delta, cos_theta.ndim) * (x2 * x2 * x)


@torch.no_grad()
def estimated(kind: str, rows: Rows, seed: int, n_paths: tuple[int, int]) -> Tensor:
    """Estimates (n, 8) of `COLUMNS`: `n_paths` bidirectional ones for two and three bounces, and walks for the longer.

    The derivative by δ is the difference of two estimates with the same random numbers.
    """
    short, short_s = _both(kind, rows, Bidirectional(Invariance(), 3), Stream(seed, n_paths[0]))
    long, long_s = _both(kind, rows, Unidirectional(Invariance(), LONGEST), Stream(seed + 1, n_paths[1]))
    tail = long[:, 3:]
    k = torch.arange(4, LONGEST + 1, dtype=tail.dtype)
    columns = [*short.unbind(-1), tail.sum(-1), (tail * k).sum(-1), short_s[:, 1], short_s[:, 2], long_s[:, 3:].sum(-1)]
    return torch.stack(columns, -1)


@torch.no_grad()
def orders(kind: str, rows: Rows, seed: int, n_paths: tuple[int, int]) -> Tensor:
    """Estimates (n, 4) of f of the orders 1, 2, 3 and ≥ 4 [1/sr] with F = 1; eager, for a few rows."""
    models = Bidirectional(Invariance(), 3), Unidirectional(Invariance(), LONGEST)
    short, long = (
        RoughConductor(KINDS[kind](rows.ax, rows.ay), Ideal(), model).orders(rows.wi, rows.wo, Stream(seed + i, n))
        for i, (model, n) in enumerate(zip(models, n_paths, strict=True))
    )
    return torch.cat([short[..., 0], long[:, 3:, 0].sum(-1, keepdim=True)], -1) / rows.wo[:, 2:]


def _both(kind: str, rows: Rows, scattering: Scattering, u: Stream) -> tuple[Tensor, Tensor]:
    """Means and derivatives of the orders (n, K)."""
    up, down = (_estimate(kind, rows, scattering, u, delta) for delta in (DELTA, -DELTA))
    return (up + down) / 2, (up - down) / (2 * DELTA)


def _estimate(kind: str, rows: Rows, scattering: Scattering, u: Stream, delta: float) -> Tensor:
    surface = compile(RoughConductor(KINDS[kind](rows.ax, rows.ay), _Probe(delta), scattering), verbose=False)
    return surface.orders(rows.wi, rows.wo, u)[..., 0] / rows.wo[:, 2:]
