"""The tables in which renderers look up what rough metal returns of light from everywhere: rows of roughness, columns of N·V.

The classical one has two columns, with which one bounce returns F0 · scale + bias. All bounces are no line in F0 but a sum
over orders: order k returns e_k F_k^k with F_k = F0 + (1 − F0) s_k, where s_k is (1 − c)⁵ of the facets that it meets, in a
mean. e_k and s_k are columns of the other table; what comes after the third bounce falls off by e_4 / (e_3 + e_4) each.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.chebyshev import polynomials
from torchms.approximations.single_bounce_energy import energy
from torchms.bsdfs import RoughConductor
from torchms.distributions import GGX
from torchms.dropins.formulas import schlick_weight
from torchms.estimators import HeightWalk
from torchms.fresnel import Schlick
from torchms.sampling.stream import Stream

SIZE = 256
QUADRATURE = (24, 24)
"""Azimuths of a half and slopes for one bounce; off by 1.1e-5 at most."""
NODES = (14, 12)
"""Roughnesses and directions of the walks, and so the terms of the polynomials between them."""
WALKS, ORDERS = 1 << 12, 32
LEAST_ALPHA = 0.02
"""Of the walks; smoother surfaces share what they lose as this one does for the same slope in units of α."""
MIDDLE = 0.5
"""The F0 at which the s_k are those of the energy; at 1 any would do."""
COLUMNS = ("scale", "bias", "e_2", "s_2", "e_3", "s_3", "e_4", "s_4")
"""Of the table of all bounces, in planes of four; the first two are the table of one."""

ONE_BOUNCE = "vec3 E = f0 * a.x + a.y;"
ALL_BOUNCES = (
    "vec3 E = f0 * a.x + a.y + a.z * pow(mix(f0, vec3(1.0), a.w), vec3(2.0))"
    " + b.x * pow(mix(f0, vec3(1.0), b.y), vec3(3.0))"
    " + b.z * pow(mix(f0, vec3(1.0), b.w), vec3(4.0))"
    " * b.x / max(b.x + b.z - b.z * mix(f0, vec3(1.0), b.w), vec3(1e-12));"
)
"""GLSL that reads the tables: a and b are texels of the planes at (N·V, roughness), E what is returned of uniform light."""

Advance = Callable[[int], None]
"""Is told of every row and every roughness of the walks that is done."""


def centres(size: int) -> Tensor:
    """Of the texels of an axis from 0 to 1."""
    return (torch.arange(size, dtype=torch.float64) + 0.5) / size


def towards(cosine: Tensor) -> Tensor:
    """(n, 3) of n cosines with the normal."""
    return torch.stack([(1 - cosine * cosine).clamp_min(0).sqrt(), torch.zeros_like(cosine), cosine], -1)


@torch.no_grad()
def one_bounce(size: int = SIZE, advance: Advance = lambda rows: None) -> Tensor:
    """(size, size, 2): scale and bias of F0, GGX with α = r² and correlated masking, Schlick's curve; by quadrature."""
    view, rows = towards(centres(size)), []
    for r in centres(size).tolist():
        alpha = torch.full((size,), r * r, dtype=torch.float64)
        whole, bias = (energy(GGX, view, alpha, alpha, *QUADRATURE, F) for F in (None, schlick_weight))
        rows.append(torch.stack([whole - bias, bias], -1))
        advance(1)
    return torch.stack(rows)


@torch.no_grad()
def all_bounces(size: int = SIZE, advance: Advance = lambda rows: None) -> Tensor:
    """(2, size, size, 4): the `COLUMNS`, in two planes. A white surface returns all light: Σ e_k = 1.

    One bounce by quadrature, what it loses shared among the orders as height walks [Heitz2016] do.
    """
    first = one_bounce(size, advance)
    alpha = (centres(size) ** 2)[:, None].expand(size, size)
    later = Later.walked(advance).at(alpha, centres(size).expand(size, size))
    e2, e3, e4 = ((1 - first.sum(-1)).clamp_min(0) * share for share in later.shares)
    s2, s3, s4 = later.weights
    return torch.stack([torch.stack([*first.unbind(-1), e2, s2], -1), torch.stack([e3, s3, e4, s4], -1)])


class Later(NamedTuple):
    """Orders 2, 3 and ≥ 4, each (roughness, direction): shares of their sum with F = 1, and s_k."""

    shares: Tensor
    weights: Tensor

    @classmethod
    def walked(cls, advance: Advance) -> "Later":
        """At the nodes."""
        found = []
        for alpha in (nodes(NODES[0], LEAST_ALPHA**0.5) ** 2).tolist():
            metal = RoughConductor(GGX(alpha), Schlick([1.0, MIDDLE]), HeightWalk(ORDERS)).double()
            # The stretched cosine is that of the slope in units of 1 / α.
            stretched = nodes(NODES[1], 0.0) ** 2
            wi = towards(alpha * stretched / (1 + (alpha * alpha - 1) * stretched * stretched).sqrt())
            orders = metal.albedo(wi, Stream(0, WALKS, "sobol")).reflected
            found.append(torch.stack([orders[:, 1], orders[:, 2], orders[:, 3:].sum(1)]))
            advance(1)
        white, some = torch.stack(found, 1).unbind(-1)
        kept = some / white
        fourth = _tail_reflectance(kept[2], white[2] / (white[1] + white[2]))
        F = torch.stack([kept[0].sqrt(), kept[1] ** (1 / 3), fourth])
        return cls(white / white.sum(0), ((F - MIDDLE) / (1 - MIDDLE)).clamp(0, 1))

    def at(self, alpha: Tensor, cosine: Tensor) -> "Later":
        """Between the nodes, and for smaller α."""
        kept = alpha.clamp_min(LEAST_ALPHA)
        stretched = cosine / torch.sqrt(cosine * cosine + alpha * alpha * (1 - cosine * cosine))
        x = _coordinate(kept.sqrt(), LEAST_ALPHA**0.5), _coordinate(stretched.sqrt(), 0.0)
        basis = [polynomials(at, n - 1) for at, n in zip(x, NODES, strict=True)]
        solved = [torch.linalg.inv(polynomials(chebyshev(n), n - 1).T) for n in NODES]
        shares, weights = (
            torch.einsum("kij,ai,bj,a...,b...->k...", values, *solved, *basis) for values in (self.shares, self.weights)
        )
        # Of facets that are flatter the cosines of grazing light are smaller by as much.
        met = (1 - weights.clamp(0, 1) ** 0.2) * (alpha / kept)
        return Later(shares.clamp(0, 1) / shares.clamp(0, 1).sum(0), (1 - met) ** 5)


def chebyshev(n: int) -> Tensor:
    """Nodes in (−1, 1)."""
    return torch.cos(torch.pi * (torch.arange(n, dtype=torch.float64) + 0.5) / n)


def nodes(n: int, low: float) -> Tensor:
    """Nodes between `low` and 1."""
    return low + (1 - low) * (chebyshev(n) + 1) / 2


def _coordinate(value: Tensor, low: float) -> Tensor:
    return 2 * (value - low) / (1 - low) - 1


def _tail_reflectance(kept: Tensor, fall: Tensor) -> Tensor:
    """F with F⁴ (1 − ρ) / (1 − ρ F) = kept, which grows with F: by bisection."""
    low, high = torch.zeros_like(kept), torch.ones_like(kept)
    for _ in range(52):
        F = (low + high) / 2
        more = F**4 * (1 - fall) < kept * (1 - fall * F)
        low, high = torch.where(more, F, low), torch.where(more, high, F)
    return (low + high) / 2
