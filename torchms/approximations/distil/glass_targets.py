"""What a distillation of glass learns from: unbiased estimates of one bounce and of all others together."""

import torch
from torch import Tensor

from torchms.approximations.distil.glass_rows import Surfaces
from torchms.bsdfs import RoughDielectric
from torchms.bsdfs.base import BSDF
from torchms.bsdfs.compile import compile
from torchms.estimators import Bidirectional, HeightWalk, Scattering, SingleBounce
from torchms.fresnel import Dielectric
from torchms.paths.height import RandomHeight
from torchms.sampling.stream import Stream

SHORT, LONGEST = 6, 16
"""Bounces that walks from both ends are joined for, and of those from one end."""


def glass(kind: str, where: Surfaces, scattering: Scattering) -> BSDF:
    """Glass without the η² of radiance, a surface a row, as machine code."""
    surface = RoughDielectric(where.distribution(kind), Dielectric(where.eta), scattering, "importance")
    return compile(surface, verbose=False)


@torch.no_grad()
def estimated(kind: str, where: Surfaces, wo: Tensor, seed: int, n_paths: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """f · |cos θ_o| [1/sr] of one bounce, which is exact, and of the rest (n), each; two independent `seed`s are taken.

    n_paths: of up to SHORT bounces, joined from both ends, and of longer ones.
    """
    short = glass(kind, where, Bidirectional(RandomHeight(), SHORT)).orders(where.wi, wo, Stream(2 * seed, n_paths[0]))
    long = glass(kind, where, HeightWalk(LONGEST)).orders(where.wi, wo, Stream(2 * seed + 1, n_paths[1]))
    return short[:, 0, 0], short[:, 1:, 0].sum(1) + long[:, SHORT:, 0].sum(1)


@torch.no_grad()
def first_energy(kind: str, where: Surfaces, seed: int, paths: int = 4096) -> Tensor:
    """R + T of one bounce (n)."""
    one = glass(kind, where, SingleBounce()).albedo(where.wi, Stream(seed, paths, "sobol"))
    return (one.reflected + one.transmitted)[:, 0, 0]
