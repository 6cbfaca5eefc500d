"""Writes the albedo tables of `torchms.approximations`: python -m tools.generate_tables [distribution …]

The energy of one bounce off facets with F = 1 is `energy_lost`, a quadrature whose error is below 1e-5; that of a
dielectric is `RoughDielectric(…, SingleBounce()).albedo` with 2^12 scrambled Sobol points. Chebyshev series are fitted to
both on tensor grids of nodes by weighted least squares. Takes a few minutes and writes the same numbers every time.
"""

import io
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.approximations import albedo_table
from torchms.approximations import coordinates as at
from torchms.approximations.albedo_table import FORMAT, SHAPES, AlbedoTable, provenance
from torchms.approximations.chebyshev import polynomials
from torchms.approximations.single_bounce_energy import crowded, energy_lost, gauss
from torchms.bsdfs import RoughDielectric
from torchms.distributions import GGX, Beckmann
from torchms.distributions.base import EllipticDistribution
from torchms.estimators import SingleBounce
from torchms.fresnel import Dielectric
from torchms.maths.frame import split
from torchms.sampling.uniforms import draw, generator_for
from torchms.storage.write import write_whole

FOLDER = Path(albedo_table.__file__).parent
KINDS = {"GGX": GGX, "Beckmann": Beckmann}
OVER = 1.25
"""Nodes along an axis for each coefficient."""
RCOND = 1e-7
"""Directions of the fit that the nodes determine worse than that are left out, so that no coefficient is large."""
POINTS = {"GGX": (112, 32), "Beckmann": (56, 24)}
"""Quadrature points over half a turn of the slopes and along a radius."""
SOBOL = 1 << 12
ROWS = 256
"""Nodes of the dielectric that are evaluated at a time."""


def nodes(coefficients: int) -> Tensor:
    """Chebyshev nodes in [−1, 1] for so many coefficients."""
    n = math.ceil(OVER * coefficients) + 1
    return torch.cos(math.pi * (torch.arange(n, dtype=torch.float64) + 0.5) / n)


def directions(t: Tensor, psi: Tensor, ax: Tensor, ay: Tensor, square_root: bool) -> Tensor:
    """Unit directions (…, 3) at the coordinate t and the stretched azimuth psi."""
    z = at.stretched_cosine(t, square_root)
    r = (1 - z * z).clamp_min(0).sqrt()
    w = torch.stack(torch.broadcast_tensors(r * psi.cos() / ax, r * psi.sin() / ay, z), -1)
    return w / w.norm(dim=-1, keepdim=True)


def fit(
    values: Tensor, x: tuple[Tensor, Tensor, Tensor], scale: tuple[Tensor, Tensor], p: Tensor, shape: tuple
) -> Tensor:
    """Coefficients of values (n_t, n_a, n_c) ≈ scale_ta · scale_c · Σ C_ijk T_i(t) T_j(a) T_k(c); weights p^−¼ over t, a."""
    t, a, c = (polynomials(axis, n - 1) for axis, n in zip(x, shape, strict=True))
    weight = p.reshape(-1, 1) ** -0.25
    plane = torch.einsum("it,ja->taij", t, a).reshape(t.shape[1] * a.shape[1], -1) * scale[0].reshape(-1, 1)
    line = c.T * scale[1][:, None]
    right = values.reshape(len(plane), -1) * weight
    half = torch.linalg.lstsq(plane * weight, right, driver="gelsd", rcond=RCOND).solution
    whole = torch.linalg.lstsq(line, half.T, driver="gelsd", rcond=RCOND).solution
    return whole.T.reshape(shape)


def conductor(name: str) -> Tensor:
    """Coefficients (harmonics, t, size, shape) of the loss with F = 1."""
    harmonics, *shape = SHAPES["loss"]
    root = at.SQUARE_ROOT[name]
    x = t, a, c = nodes(shape[0]), nodes(shape[1]), nodes(shape[2])
    psi = (torch.arange(harmonics + 5, dtype=torch.float64) + 0.5) * (math.pi / 2 / (harmonics + 5))
    T, M, Q, PSI = torch.meshgrid((t + 1) / 2, at.size_at(a), at.shape_at(c), psi, indexing="ij")
    ax, ay = M * (1 + Q), M * (1 - Q)
    w = directions(T, PSI, ax, ay, root)
    lost = energy_lost(KINDS[name], w.reshape(-1, 3), ax.reshape(-1), ay.reshape(-1), *POINTS[name])
    lost = lost.reshape(T.shape)
    p = at.view(split(w), ax, ay, root).p[:, :, 0, 0]
    rho2 = (1 - at.stretched_cosine((t + 1) / 2, root) ** 2)[:, None].expand(p.shape)
    found = []
    for k in range(harmonics):
        along = (lost * torch.cos(2 * k * psi)).mean(-1) * (2 if k else 1)
        found.append(fit(along, x, (p * rho2**k, at.shape_at(c) ** k), p, tuple(shape)))
    return torch.stack(found)


def dielectric(name: str) -> Tensor:
    """Coefficients (side, t, size, eta) of what reflection and refraction lose together; α_x = α_y."""
    _, *shape = SHAPES["glass_loss"]
    root = at.SQUARE_ROOT[name]
    x = t, a, c = nodes(shape[0]), nodes(shape[1]), nodes(shape[2])
    T, M, ETA = torch.meshgrid((t + 1) / 2, at.size_at(a), at.eta_at(c), indexing="ij")
    w = directions(T, torch.full_like(T, 0.3), M, M, root)
    p = at.view(split(w), M, M, root).p[:, :, 0]
    found = []
    for sign in (1.0, -1.0):
        lost = dielectric_lost(KINDS[name], sign * w.reshape(-1, 3), M.reshape(-1), ETA.reshape(-1)).reshape(T.shape)
        found.append(fit(lost, x, (p, torch.ones_like(c)), p, tuple(shape)))
    return torch.stack(found)


@torch.no_grad()
def dielectric_lost(kind: type[EllipticDistribution], wi: Tensor, alpha: Tensor, eta: Tensor) -> Tensor:
    """1 − E_r − E_t of one bounce; wi (n, 3) from either side, α and n_inside / n_outside (n)."""
    parts = []
    for rows in torch.arange(len(wi)).split(ROWS):
        bsdf = RoughDielectric(kind(alpha[rows].clamp(*at.ALPHA)), Dielectric(eta[rows]), SingleBounce(), "importance")
        u = draw((), SOBOL, bsdf.n_uniforms, generator=generator_for(1), sequence="sobol", dtype=torch.float64)
        energy = bsdf.albedo(wi[rows], u)
        parts.append(1 - (energy.reflected + energy.transmitted)[:, 0, 0])
    return torch.cat(parts)


def log_means(table: AlbedoTable, name: str) -> tuple[Tensor, Tensor]:
    """Coefficients of ln(1 − E_avg), (size, shape) and (side, size, eta): the means of the fitted series themselves."""
    rows = nodes(SHAPES["mean"][0])
    columns = nodes(SHAPES["mean"][1])
    M, Q = torch.meshgrid(at.log_at(rows), at.shape_at(columns), indexing="ij")
    mean = _mean(table, M * (1 + Q), M * (1 - Q), None)
    shapes = SHAPES["mean"], SHAPES["glass_mean"][1:]
    found = [_fit_plane(mean.log(), rows, columns, shapes[0])]
    rows, columns = nodes(shapes[1][0]), nodes(shapes[1][1])
    M, ETA = torch.meshgrid(at.log_at(rows), at.eta_at(columns), indexing="ij")
    sides = [_fit_plane(_mean(table, M, M, ETA, side).log(), rows, columns, shapes[1]) for side in (1.0, -1.0)]
    return found[0], torch.stack(sides)


def _mean(table: AlbedoTable, ax: Tensor, ay: Tensor, eta: Tensor | None, side: float = 1.0) -> Tensor:
    """2 ∫ (1 − E) μ dμ, averaged over the azimuth, of each α (the nodes of E follow α towards grazing incidence)."""
    x, weight = gauss(160)
    mu, weight = x**4, weight * 4 * x**3 * 2 * x**4
    turns, share = (torch.tensor([0.0]).double(), torch.ones(1).double()) if eta is not None else crowded(48)
    psi = turns * math.pi / 2
    total = torch.zeros_like(ax)
    for angle, part in zip(psi, share, strict=True):
        k = (ax / ay).sqrt()
        phi = torch.atan2(k * angle.sin(), angle.cos())
        jacobian = k / (angle.cos() ** 2 + k * k * angle.sin() ** 2)
        r = (1 - mu * mu).sqrt()
        w = split(torch.stack(torch.broadcast_tensors(r * phi.cos()[..., None], r * phi.sin()[..., None], mu), -1))
        distribution = GGX(1.0) if table.distribution == "GGX" else Beckmann(1.0)
        distribution.alpha, distribution.alpha_y = ax[..., None], ay[..., None]
        if eta is None:
            lost = table.loss(distribution, w)
        else:
            lost = table.glass_loss(distribution, w, eta[..., None], torch.tensor(side))
        total = total + part * jacobian * (lost * weight).sum(-1)
    return total


def _fit_plane(values: Tensor, x: Tensor, y: Tensor, shape: tuple) -> Tensor:
    a, b = polynomials(x, shape[0] - 1).T, polynomials(y, shape[1] - 1).T
    half = torch.linalg.lstsq(a, values, driver="gelsd", rcond=RCOND).solution
    return torch.linalg.lstsq(b, half.T, driver="gelsd", rcond=RCOND).solution.T


def generated(name: str) -> bytes:
    """The file of one distribution."""
    arrays = {"loss": conductor(name), "glass_loss": dielectric(name)}
    arrays |= {key: torch.zeros(SHAPES[key], dtype=torch.float64) for key in ("mean", "glass_mean")}
    rounded = {key: value.float() for key, value in arrays.items()}
    table = AlbedoTable(name, {key: value.double() for key, value in rounded.items()})
    rounded["mean"], rounded["glass_mean"] = (value.float() for value in log_means(table, name))
    file = io.BytesIO()
    content: dict[str, Any] = {key: value.numpy() for key, value in rounded.items()}
    content |= {"format": np.array(FORMAT), "distribution": np.array(name), "provenance": np.array(provenance(name))}
    np.savez_compressed(file, **content)
    return file.getvalue()


def main(names: list[str]) -> None:
    torch.set_default_dtype(torch.float64)
    for name in names or list(KINDS):
        if name not in KINDS:
            raise SystemExit(f"there is no table of {name!r}; known: {', '.join(KINDS)}.")
        path = FOLDER / f"{name.lower()}.npz"
        write_whole(path, generated(name), force=True)
        print(f"{path.name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1:])
