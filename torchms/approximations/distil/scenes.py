"""Surfaces and directions that glass and diffuse facets are distilled at."""

import math

import numpy as np
import torch
from torch import Tensor

from torchms.maths.frame import Vec3, join
from torchms.sampling.uniforms import draw

LEAST_COSINE = 1e-4


def roughnesses(
    alpha: tuple[float, float], n: int, isotropic: float, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """α_x and α_y (n): half evenly in the logarithm, half evenly; this share `isotropic`."""
    low, high = alpha
    u = draw((n,), 1, 4, generator=generator)[:, 0].unbind(-1)

    def one(x: Tensor) -> Tensor:
        return torch.where(u[2] < 0.5, low * (high / low) ** x, low + (high - low) * x)

    ax, ay = one(u[0]), one(u[1])
    return ax, torch.where(u[3] < isotropic, ax, ay)


def hemisphere(n: int, generator: torch.Generator) -> Tensor:
    """Directions (n, 3) above the horizon: half uniform, half uniform in the angle, of which more are grazing."""
    u = draw((n,), 1, 3, generator=generator)[:, 0].unbind(-1)
    z = torch.where(u[2] < 0.5, u[0], torch.cos(0.5 * math.pi * u[0])).clamp(LEAST_COSINE, 1)
    r = (1 - z * z).clamp_min(0).sqrt()
    turn = 2 * math.pi * u[1]
    return join(Vec3(r * turn.cos(), r * turn.sin(), z))


def indices(n: int, least: float, most: float, generator: torch.Generator) -> Tensor:
    """Relative indices η (n), |ln η| from `least` to ln `most` of either sign, a third of them evenly in its logarithm."""
    u = draw((n,), 1, 3, generator=generator)[:, 0].unbind(-1)
    high = math.log(most)
    log = torch.where(u[2] < 0.35, least * (high / least) ** u[0], least + (high - least) * u[0])
    return torch.exp(torch.where(u[1] < 0.5, -log, log))


def gauss(n: int) -> tuple[Tensor, Tensor]:
    """Nodes and weights on [0, 1], float32."""
    x, w = np.polynomial.legendre.leggauss(n)
    return torch.from_numpy((x + 1) / 2).float(), torch.from_numpy(w / 2).float()
