"""The tables of single-bounce energies: how far off they are, and which files are refused."""

import io
import math

import numpy as np
import pytest
import torch
from cases import ELLIPTIC, directions, each
from torch import Tensor

from torchms import RoughConductor, RoughDielectric, SingleBounce
from torchms.approximations import AlbedoTable
from torchms.approximations.albedo_table import FORMAT, SHAPES
from torchms.approximations.single_bounce_energy import energy_lost
from torchms.fresnel import Dielectric, Ideal
from torchms.maths.frame import split

NAMES = {"ggx": "GGX", "beckmann": "Beckmann"}


def table(distribution: str) -> AlbedoTable:
    return AlbedoTable.packaged(NAMES[distribution]).double()


def logarithmic(low: float, high: float, n: int, generator: torch.Generator) -> Tensor:
    return low * (high / low) ** torch.rand(n, generator=generator, dtype=torch.float64)


def error(generator: torch.Generator, distribution: str, anisotropic: bool, n: int = 400) -> Tensor:
    """Error of E at random directions and roughnesses, against quadrature of many more points than the generator's."""
    wi = directions(n, generator, 0.0)
    # Half of them as close to the horizon as the roughness is small: there the energy changes most.
    ax = logarithmic(1e-3, 2, n, generator)
    ay = logarithmic(1e-3, 2, n, generator) if anisotropic else ax
    tau = torch.rand(n, generator=generator, dtype=torch.float64) * 3
    z = torch.where(torch.arange(n) % 2 == 0, wi[:, 2], tau * torch.minimum(ax, ay) / (1 + tau * torch.minimum(ax, ay)))
    flat = torch.nn.functional.normalize(wi[:, :2], dim=-1) * (1 - z * z).sqrt()[:, None]
    wi = torch.cat([flat, z[:, None]], -1)
    kind = ELLIPTIC[distribution]
    truth = energy_lost(type(kind(1.0)), wi, ax, ay, 128, 48)
    found = table(distribution).loss(kind(ax, ay) if anisotropic else kind(ax), split(wi))
    return (found - truth).abs()


@each("distribution", ELLIPTIC)
def test_interpolation_error(distribution, generator):
    """Below 1e-4 off the grid, for all α_x = α_y and all directions."""
    assert float(error(generator, distribution, False).max()) < 1e-4


@each("distribution", ELLIPTIC)
def test_interpolation_error_of_anisotropy(distribution, generator):
    """Root mean square 1e-4, below 1e-3 everywhere, for α_x / α_y up to 2000."""
    off = error(generator, distribution, True)
    assert float(off.square().mean().sqrt()) < 1e-4
    assert float(off.max()) < 1e-3


@each("distribution", ELLIPTIC)
def test_quadrature_is_the_single_bounce(distribution, generator):
    """What the tables are made of is the albedo of SingleBounce, drawn by visible normals."""
    wi, n = directions(24, generator, 0.1), 24
    ax, ay = logarithmic(0.05, 2, n, generator), logarithmic(0.05, 2, n, generator)
    kind = ELLIPTIC[distribution]
    surface = RoughConductor(kind(ax, ay), Ideal(), SingleBounce())
    u = surface.uniforms((1,), 1 << 13, generator=generator, sequence="sobol")
    drawn = 1 - surface.albedo(wi, u).reflected[:, 0, 0]
    assert float((drawn - energy_lost(type(kind(1.0)), wi, ax, ay)).abs().max()) < 5e-4


@each("distribution", ELLIPTIC)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_glass_against_the_single_bounce(distribution, side, generator):
    """Reflection and transmission together, from either side, at indices off the grid."""
    n = 60
    wi, alpha = directions(n, generator, 0.02), logarithmic(0.02, 1.5, n, generator)
    eta = logarithmic(1.05, 2.8, n, generator)
    kind = ELLIPTIC[distribution]
    surface = RoughDielectric(kind(alpha), Dielectric(eta), SingleBounce())
    u = surface.uniforms((1,), 1 << 13, generator=generator, sequence="sobol")
    energy = surface.albedo(side * wi, u)
    drawn = 1 - (energy.reflected + energy.transmitted)[:, 0, 0]
    found = table(distribution).glass_loss(kind(alpha), split(wi), eta, torch.tensor(side))
    off = (found - drawn).abs()
    # Near grazing incidence and total reflection E has edges that a series rounds off.
    assert float(off.median()) < 2e-3
    assert float(off.max()) < 0.05


@each("distribution", ELLIPTIC)
@pytest.mark.parametrize("alpha", [(1e-3, 1e-3), (0.05, 0.05), (0.5, 0.5), (2.0, 2.0), (0.8, 0.1), (0.02, 1.0)])
def test_mean_is_the_mean_of_the_table(distribution, alpha):
    """1 − E_avg = 2 ∫∫ (1 − E) μ dμ dφ / 2π of the very series, relative to itself: so a furnace stays white."""
    each_alpha = [torch.tensor(a, dtype=torch.float64) for a in alpha]
    distribution_ = ELLIPTIC[distribution](*each_alpha)
    x, weight = (torch.from_numpy(v) for v in np.polynomial.legendre.leggauss(300))
    x, weight = (x + 1) / 2, weight / 2
    mu, weight = x**4, weight * 8 * x**7
    psi = (torch.arange(200, dtype=torch.float64) + 0.5) * (math.pi / 400)
    k = math.sqrt(alpha[0] / alpha[1])
    phi = torch.atan2(k * psi.sin(), psi.cos())[:, None]
    jacobian = k / (psi.cos() ** 2 + k * k * psi.sin() ** 2)
    r = (1 - mu * mu).sqrt()
    w = torch.stack(torch.broadcast_tensors(r * phi.cos(), r * phi.sin(), mu), -1)
    lost = (table(distribution).loss(distribution_, split(w)) * weight).sum(-1)
    mean = float((lost * jacobian).mean())
    assert float(table(distribution).mean_loss(distribution_)) == pytest.approx(mean, rel=2e-3)


@each("distribution", ELLIPTIC)
def test_exchange_of_the_axes(distribution, generator):
    """E is the same after x and y change places, and α_x = α_y given twice is α given once."""
    w = directions(200, generator, 0.0)
    ax, ay = logarithmic(0.01, 2, 200, generator), logarithmic(0.01, 2, 200, generator)
    kind, here = ELLIPTIC[distribution], table(distribution)
    there = here.loss(kind(ay, ax), split(w[:, [1, 0, 2]]))
    torch.testing.assert_close(here.loss(kind(ax, ay), split(w)), there, rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(
        here.loss(kind(ax, ax.clone()), split(w)), here.loss(kind(ax), split(w)), rtol=1e-4, atol=1e-6
    )


def content(**changes) -> dict[str, np.ndarray]:
    """A valid file's arrays, with changes; None leaves one out."""
    found = {
        "format": np.array(FORMAT),
        "distribution": np.array("GGX"),
        "provenance": np.array("a test"),
        **{name: np.zeros(shape, np.float32) for name, shape in SHAPES.items()},
    } | changes
    return {name: value for name, value in found.items() if value is not None}


BAD = {
    "another version": (dict(format=np.array(99)), "of format 99"),
    "NaN": (dict(loss=np.full(SHAPES["loss"], np.nan, np.float32)), "'loss' holds NaN"),
    "shape": (dict(mean=np.zeros((3, 3), np.float32)), r"'mean' must have shape .* got \(3, 3\)"),
    "dtype": (dict(mean=np.zeros(SHAPES["mean"])), "must be float32; got float64"),
    "lacking": (dict(mean=None), "lacks mean"),
    "distribution": (dict(distribution=np.array("Phong")), "must be one of GGX, Beckmann; got 'Phong'"),
    "size": (dict(loss=np.zeros(5_000_000, np.float32)), "would unpack to"),
    "pickle": (dict(loss=np.array([{"a": 1}], dtype=object)), "(?i)pickle|object"),
}


@each("case", BAD)
def test_bad_files_are_refused(case, tmp_path, messages):
    changes, message = BAD[case]
    path = tmp_path / "table.npz"
    np.savez_compressed(path, **content(**changes))
    with pytest.raises(ValueError, match=message):
        AlbedoTable.load(path)


def test_damaged_files_are_refused(tmp_path, messages):
    file = io.BytesIO()
    np.savez_compressed(file, **content())
    path = tmp_path / "table.npz"
    with pytest.raises(FileNotFoundError, match="there is no file"):
        AlbedoTable.load(path)
    for damage in (file.getvalue()[: len(file.getvalue()) // 2], b"", b"not a file of ours"):
        path.write_bytes(damage)
        with pytest.raises(ValueError, match=r"truncated or no \.npz"):
            AlbedoTable.load(path)
    path.write_bytes(file.getvalue())
    assert AlbedoTable.load(path).distribution == "GGX"
