"""Writes the table of layers of `torchms.approximations`: python -m tools.generate_layered

The energies are those of the lobes of `Distilled` in the package, so the table is written anew whenever those are. For each
node of the roughness: the energy of one bounce by quadrature, of further ones and of rough diffuse facets with 2^12
scrambled Sobol points; then the series of the factors n and s that make all of it white. Takes half a minute and writes
the same numbers every time.
"""

import io
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchms.approximations import layered_table as at
from torchms.approximations.chebyshev import polynomials
from torchms.approximations.facet_reflectance import Met, reflected
from torchms.approximations.layered import DiffuseBase, fingerprint, learned, lobes_file
from torchms.approximations.metal_lobes import MetalLobes
from torchms.approximations.metal_sampling import MetalProposal
from torchms.approximations.single_bounce_energy import energy
from torchms.distributions import GGX
from torchms.maths.frame import Vec3
from torchms.sampling.uniforms import draw, generator_for
from torchms.sampling.warps import cosine_hemisphere
from torchms.storage.write import write_whole
from torchms.version import __version__

PATH = Path(at.__file__).parent / "layered_ggx.npz"
NODES = {"cosine": 28, "size": 20, "level": 9}
POINTS = 1 << 12
QUADRATURE = (112, 32)
SMOOTH = 1e-3
"""α of a smooth layer."""
STEPS, DAMPING = 12, 1e-9


def nodes(n: int) -> Tensor:
    """Chebyshev nodes in [−1, 1]."""
    return torch.cos(math.pi * (torch.arange(n, dtype=torch.float64) + 0.5) / n)


def directions(x: Tensor) -> Vec3:
    """At the coordinate x of √cos θ."""
    z = ((x + 1) / 2) ** 2
    return Vec3((1 - z * z).clamp_min(0).sqrt(), torch.zeros_like(z), z)


class Samples(NamedTuple):
    """Of one roughness, (cosine nodes, points): basis (…, nodes) of the nodes at wo, and, over their density, the lobes of
    the orders 2, 3 and ≥ 4 with F = 1 and of a white diffuse surface; the facets that they meet; r."""

    basis: Tensor
    lobes: list[Tensor]
    facets: list[Met]
    fall: Tensor
    diffuse: Tensor


def lagrange(x: Tensor, n: int) -> Tensor:
    """(*x, n): the polynomials that are 1 at one of the nodes and 0 at the others."""
    T = polynomials(x, n - 1).movedim(0, -1)
    at_nodes = polynomials(nodes(n), n - 1).T
    return torch.linalg.solve(at_nodes.T, T[..., None])[..., 0]


def sampled(alpha: float) -> Samples:
    """The lobes of one roughness, along directions that are dense where they are large."""
    n, distribution = NODES["cosine"], GGX(alpha).double()
    w = directions(nodes(n))
    w = Vec3(*(c[:, None] for c in w))
    u = draw((), POINTS, 4, generator=generator_for(1), sequence="sobol", dtype=torch.float64).T
    proposal = MetalProposal(distribution)
    some, flat = proposal.sample(w, list(u[:3])), cosine_hemisphere(u[1], u[2])
    d = Vec3(*(torch.where(u[3] < 0.5, a, b) for a, b in zip(some, flat, strict=True)))
    d = Vec3(d.x, d.y, d.z.clamp_min(1e-9))
    density = 0.5 * proposal.density(w, d) + 0.5 * d.z / math.pi
    metal = MetalLobes(lobes_file("metal"))
    smooth = learned(distribution, "metal")
    rest = metal.rest(smooth, w, d)
    white = DiffuseBase(True).returned(distribution, torch.ones(1, 1, 1), w, d)[0]
    over = d.z / density
    return Samples(
        lagrange(2 * d.z.sqrt() - 1, n),
        [lobe * over for lobe in rest.lobes],
        metal.facets(smooth, w, d),
        rest.fall,
        white / density,
    )


def factor(kernels: Tensor, wanted: Tensor, grid: Tensor, weight: Tensor, exponential: bool) -> Tensor:
    """Coefficients c, (parameters), of s = grid · c, or its exponential, with s_i Σ_j kernel_ij s_j = wanted_i, by
    Gauss–Newton on weighted squares; kernels (blocks, n, n), wanted and weight (blocks, n), grid (blocks, n, parameters)."""
    c = torch.zeros(grid.shape[-1], dtype=torch.float64)
    if not exponential:
        c[0] = 0.9
    for _ in range(STEPS):
        v = grid @ c
        s = v.exp() if exponential else v
        seen = torch.einsum("bij,bj->bi", kernels, s)
        slope = torch.diag_embed(seen) + s[:, :, None] * kernels
        slope = slope * s[:, None, :] if exponential else slope
        jacobian = (weight[:, :, None] * (slope @ grid)).reshape(-1, len(c))
        square = jacobian.T @ jacobian
        square = square + DAMPING * square.diagonal().mean() * torch.eye(len(c), dtype=torch.float64)
        step = torch.linalg.solve(square, jacobian.T @ ((s * seen - wanted) * weight).reshape(-1))
        c = c - step * min(1.0, 0.5 / float((grid @ step).abs().max())) if exponential else c - step
    return c


def series(*axes: tuple[Tensor, int]) -> Tensor:
    """(nodes, …, coefficients): products of polynomials along axes, each given by its nodes and coefficients."""
    found = torch.ones(1, dtype=torch.float64)
    for x, n in axes:
        found = torch.einsum("...i,ab->...aib", found.reshape(*found.shape[:-1], -1), polynomials(x, n - 1).T)
        found = found.flatten(-2)
    return found


def fit(values: Tensor, *axes: tuple[Tensor, int]) -> Tensor:
    """Coefficients of values on the grid of `axes`, by least squares."""
    grid = series(*axes)
    found = torch.linalg.lstsq(grid.reshape(-1, grid.shape[-1]), values.reshape(-1, 1)).solution
    return found.reshape([n for _, n in axes])


class Energies(NamedTuple):
    """Of some roughnesses: E of each order (sizes, levels, cosines), (1 − E) / (1 − F0), and the diffuse kernels."""

    orders: list[Tensor]
    through: Tensor
    diffuse: Tensor


def layers(
    alphas: Tensor, found: list[Samples], one: list[tuple[Tensor, Tensor]], n: Tensor, levels: Tensor
) -> Energies:
    """With the factors n (sizes, cosines) of the further orders."""
    orders: list[list[Tensor]] = [[], [], [], []]
    through, diffuse = [], []
    for alpha, samples, first, factors in zip(alphas, found, one, n, strict=True):
        energies = order_energies(samples, factors, first, levels)
        white = torch.stack([e[:, 0] for e in order_energies(samples, factors, first, torch.ones(1))]).sum(0)
        through.append(((white[:, None] - sum(energies[1:], energies[0])) / (1 - levels)).T)
        diffuse.append((samples.diffuse[..., None] * samples.basis).mean(1))
        for column, e in zip(orders, energies, strict=True):
            column.append(e.T)
        print(f"alpha {float(alpha):.4f}: white to {float((white - 1).abs().max()):.1e}")
    return Energies([torch.stack(column) for column in orders], torch.stack(through), torch.stack(diffuse))


def measured(alphas: Tensor, cosines: Tensor) -> tuple[list[Samples], list[tuple[Tensor, Tensor]]]:
    """What the factors are computed from: further orders, and one bounce."""
    w = torch.stack(directions(cosines), -1)
    return [sampled(float(a)) for a in alphas], [first_energies(w, float(a)) for a in alphas]


@torch.no_grad()
def generated() -> dict[str, Tensor]:
    """The coefficients."""
    x, a, f = nodes(NODES["cosine"]), nodes(NODES["size"]), nodes(NODES["level"])
    alphas, levels = at.size_at(a), (f + 1) / 2
    found, one = measured(alphas, x)
    kernels = torch.stack([(sum(s.lobes[1:], s.lobes[0])[..., None] * s.basis).mean(1) for s in found])
    lost = torch.stack([1 - e[0] for e in one])
    grid = series((a, at.SIZES), (x, at.COSINES))
    # Where next to nothing is lost, and where light grazes, it matters less.
    mu = ((x + 1) / 2) ** 2
    c = factor(kernels, lost, grid, (mu / (mu + 0.02)).clamp_min(0.1) / (lost + 0.03), True)
    out = {"level": c.reshape(at.SIZES, at.COSINES).T}
    parts = [coupled(layers(alphas, found, one, (grid @ c).exp(), levels), (a, at.FEWER_SIZES, at.SIZES), x, f)]
    smooth = torch.tensor([SMOOTH])
    found, one = measured(smooth, x)
    parts.append(coupled(layers(smooth, found, one, torch.zeros(1, len(x)), levels), (torch.zeros(1), 1, 1), x, f))
    return out | {name: torch.cat([part[name] for part in parts], -1) for name in parts[0]}


def coupled(energies: Energies, along: tuple[Tensor, int, int], x: Tensor, f: Tensor) -> dict[str, Tensor]:
    """The series of these layers, the roughness last; `along` it: nodes, coefficients of s and of energies."""
    a, sizes, more = along
    levels, T = (f + 1) / 2, energies.through
    blocks = T.shape[0] * T.shape[1]
    grid = series((a, sizes), (f, at.LEVELS), (x, at.FEWER_COSINES)).reshape(blocks, len(x), -1)
    weight = (1 - levels)[None, :, None].expand(T.shape).reshape(blocks, -1)
    flat = mean_row(x).expand(T.shape[0], len(x), len(x))
    out = {}
    for name, kernel in (("lambert", flat), ("rough", energies.diffuse)):
        kernels = kernel[:, None].expand(*T.shape[:2], *kernel.shape[1:]).reshape(blocks, len(x), len(x))
        c = factor(kernels, T.reshape(blocks, -1), grid, weight, False)
        out[name] = c.reshape(sizes, at.LEVELS, at.FEWER_COSINES).permute(1, 2, 0)
    out["passing"] = fit(T @ mean_row(x), (a, sizes), (f, at.LEVELS)).T
    orders = [
        fit(e, (a, more), (f, n), (x, at.COSINES)).permute(1, 2, 0)
        for e, n in zip(energies.orders, at.ORDERS, strict=True)
    ]
    return out | {"energy": torch.cat(orders)}


def first_energies(w: Tensor, alpha: float) -> tuple[Tensor, Tensor]:
    """E of one bounce with F = 1, and with F = (1 − c)⁵."""
    a = torch.full((len(w),), alpha, dtype=torch.float64)
    return (
        energy(GGX, w, a, a, *QUADRATURE),
        energy(GGX, w, a, a, *QUADRATURE, reflectance=lambda c: (1 - c) ** 5),
    )


def order_energies(s: Samples, n: Tensor, one: tuple[Tensor, Tensor], levels: Tensor) -> list[Tensor]:
    """E of each order, (cosine nodes, levels)."""
    at_o = n[:, None] * (s.basis @ n)
    found = [one[0][:, None] * levels + one[1][:, None] * (1 - levels)]
    columns: list[list[Tensor]] = [[], [], []]
    for f0 in levels:
        factors = reflected(f0, [f0 + (1 - f0) * met.s for met in s.facets], s.facets, s.fall)
        for column, lobe, factor in zip(columns, s.lobes, factors, strict=True):
            column.append((lobe * factor * at_o).mean(1))
    return found + [torch.stack(column, 1) for column in columns]


def mean_row(x: Tensor) -> Tensor:
    """The weights with which 2 ∫ v μ dμ is a sum over the nodes x, exact for polynomials in √μ."""
    y, weight = np.polynomial.legendre.leggauss(2 * len(x))
    y = torch.from_numpy((y + 1) / 2)
    return (torch.from_numpy(weight / 2) * 4 * y**3) @ lagrange(2 * y - 1, len(x))


def main() -> None:
    torch.set_default_dtype(torch.float64)
    content: dict[str, Any] = {name: value.float().numpy() for name, value in generated().items()}
    content |= {"format": np.array(at.FORMAT), "lobes": np.array(fingerprint())}
    content["provenance"] = np.array(
        f"torchms {__version__}, torch {torch.__version__}; python -m tools.generate_layered; lobes {fingerprint()}, "
        f"quadrature {QUADRATURE}, {POINTS} scrambled Sobol points, Chebyshev series rounded to float32"
    )
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    write_whole(PATH, file.getvalue(), force=True)
    print(f"{PATH.name}: {PATH.stat().st_size} bytes")


if __name__ == "__main__":
    main()
