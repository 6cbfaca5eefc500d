"""Energies of a base under a rough, reflecting layer, from a table of Chebyshev series in √cos θ, √α and F0.

The layer reflects E(w) of what arrives from w and lets 1 − E(w) through. What the table holds makes the sum white:

- n(w) = exp(level): further bounces n(wi) g(wi, wo) n(wo) return just what one bounce between facets with F = 1 loses;
- s(w), the coupling: the base's lobe s(wi) k(wi, wo) s(wo) / cos θ_o returns just what the layer lets through, if k returns
  all light. For Lambert's k it is (1 − E(w)) / √(1 − E_avg), which is Kulla and Conty's form;
- 1 − E_avg, and E(w) order by order.

Factors that go to zero with 1 − F0 are taken out: s = √(1 − F0) coupling, 1 − E_avg = (1 − F0) passing.
"""

from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from torchms.approximations.chebyshev import contracted, polynomials, summed
from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon, safe_sqrt
from torchms.storage.archives import read_versioned

FORMAT = 1
"""Version of the files: of the coordinates and of what the coefficients multiply."""
ALPHA = (0.03, 1.0)
"""Range of the series along √α, for which there are lobes. Below it they go over, with α², to those of a smooth layer."""
COSINES, SIZES = 14, 11
"""Coefficients along √cos θ and √α, of n and of the energies."""
LEVELS, FEWER_COSINES, FEWER_SIZES = 4, 12, 9
"""Coefficients along F0, √cos θ and √α, of s: it is what a training computes in each step."""
ORDERS = (2, 3, 4, 7)
"""Coefficients along F0 of the energy of each order: it is a polynomial of that degree, but for the last one."""

SHAPES: dict[str, tuple[int, ...]] = {
    "level": (COSINES, SIZES),
    "lambert": (LEVELS, FEWER_COSINES, FEWER_SIZES + 1),
    "rough": (LEVELS, FEWER_COSINES, FEWER_SIZES + 1),
    "passing": (LEVELS, FEWER_SIZES + 1),
    "energy": (sum(ORDERS), COSINES, SIZES + 1),
}
"""Coefficients of each series; the last one along √α, but of n, is that of a smooth layer."""
GRAZING, GRAZING_POWER = (-4.209, 12.566, -11.261, 6.866), 0.6208
"""Of `smoother`: by least squares, so that layers of α from 0.0025 to 0.025 are white."""
GRAZING_ALPHA = (0.0025, ALPHA[0])
MOST_BYTES = 1 << 20
REMEDY = "Write it again: python -m tools.generate_layered, in the repository."


def size_axis(alpha: Tensor) -> Tensor:
    """√α, mapped to [−1, 1] from ALPHA."""
    low, high = (a**0.5 for a in ALPHA)
    return (2 * torch.sqrt(alpha.clamp_min(ALPHA[0])) - (low + high)) / (high - low)


def size_at(x: Tensor) -> Tensor:
    """α at the coordinate x: the inverse of `size_axis`."""
    low, high = (a**0.5 for a in ALPHA)
    return (low + (high - low) * (x + 1) / 2) ** 2


def level_polynomials(f0: Tensor, n: int) -> Tensor:
    """T_0 … T_{n−1} of F0, mapped from [0, 1] to [−1, 1]."""
    return polynomials(2 * f0 - 1, n - 1)


def weighed(series: Tensor, levels: Tensor) -> Tensor:
    """Σ_j series[j] · levels[j], of (n, N, …) and (n, C, 1, …): (C, N, …)."""
    return (series.unsqueeze(1) * levels).sum(0)


def cosine_polynomials(w: Vec3, n: int) -> Tensor:
    """T_0 … T_{n−1} of √cos θ; below the horizon that of a grazing direction."""
    return polynomials(2 * torch.sqrt(w.z.clamp_min(horizon(w.z.dtype))) - 1, n - 1)


def along(series: Tensor, w: Vec3) -> Tensor:
    """(n, N, …): n series in √cos θ, (n, coefficients, *batch), at `w`."""
    basis = cosine_polynomials(w, series.shape[1])
    return torch.stack([summed(one, basis) for one in series])


class Layer(NamedTuple):
    """The series of s and of 1 − E_avg for one roughness: coefficients (…, *batch of the roughness)."""

    coupling: Tensor
    passing: Tensor

    def coupling_at(self, w: Vec3, levels: Tensor) -> Tensor:
        """s(w) / √(1 − F0), (C, N, …); `levels` (LEVELS, C, 1, …) of F0."""
        return weighed(along(self.coupling, w), levels)


class LayeredTable(nn.Module):
    """The series of rough GGX layers, α in [1e-3, 1]; see the head of the file.

    Raises ValueError for coefficients of other shapes, or that are not finite.
    """

    c_level: Tensor
    c_lambert: Tensor
    c_rough: Tensor
    c_passing: Tensor
    c_energy: Tensor

    def __init__(self, coefficients: dict[str, Tensor], lobes: str = "") -> None:
        super().__init__()
        for name, shape in SHAPES.items():
            value = coefficients.get(name)
            if value is None or tuple(value.shape) != shape or not bool(value.isfinite().all()):
                found = "none" if value is None else tuple(value.shape)
                raise ValueError(f"LayeredTable: {name!r} must be finite numbers {shape}; got {found}. {REMEDY}")
            self.register_buffer(f"c_{name}", value, persistent=False)
        self.lobes = lobes
        """Of which lobes the energies are: see `fingerprint`."""

    @classmethod
    def load(cls, path: str | Path) -> "LayeredTable":
        """The table in the file `path`; FileNotFoundError for none, ValueError for one damaged or of another format."""
        arrays = read_versioned(Path(path), MOST_BYTES, FORMAT, "layers", REMEDY)
        known = {n: torch.from_numpy(x) for n, x in arrays.items() if n in SHAPES and x.dtype == np.float32}
        return cls(known, str(arrays.get("lobes", np.array("")).item()))

    @classmethod
    def packaged(cls) -> "LayeredTable":
        """The table that comes with torchms."""
        with resources.as_file(resources.files("torchms.approximations") / "layered_ggx.npz") as path:
            return cls.load(path)

    def level(self, alpha: Tensor, w: Vec3) -> Tensor:
        """Kernel: ln n(w), (N, …)."""
        series = contracted(self.c_level, polynomials(size_axis(alpha), SIZES - 1))
        return summed(series, cosine_polynomials(w, COSINES)) + smoother(alpha, w)

    def layer(self, alpha: Tensor, rough: bool) -> Layer:
        """Kernel: the series of this roughness; `rough`: for a base of rough diffuse facets, not Lambert's."""
        basis = blended(alpha, FEWER_SIZES)
        return Layer(contracted(self.c_rough if rough else self.c_lambert, basis), contracted(self.c_passing, basis))

    def energies(self, alpha: Tensor, w: Vec3, f0: Tensor) -> list[Tensor]:
        """Kernel: E(w) of each order of the layer, each (C, N, …); `f0` (C, 1, …)."""
        series = along(contracted(self.c_energy, blended(alpha, SIZES)), w)
        levels = level_polynomials(f0, max(ORDERS))
        return [weighed(part, levels[: len(part)]) for part in series.split(ORDERS)]


def blended(alpha: Tensor, sizes: int) -> Tensor:
    """The basis along √α, and behind it that of a smooth layer."""
    part = (alpha / ALPHA[0]).clamp_max(1.0)
    share = part * part
    return torch.cat([polynomials(size_axis(alpha), sizes - 1) * share, (1 - share).unsqueeze(0)])


def smoother(alpha: Tensor, w: Vec3) -> Tensor:
    """ln n(w) of a layer with α < 0.03 over that with 0.03, whose lobes both have; 0 for others.

    What one bounce loses is a share of α², so of each of two directions α, but where light grazes a function of α tan θ.
    """
    z = w.z.clamp_min(horizon(w.z.dtype))
    tan = safe_sqrt(1 - z * z) / z
    grazing = _grazing(ALPHA[0] * tan) / _grazing(alpha.clamp(*GRAZING_ALPHA) * tan)
    return torch.log((alpha / ALPHA[0]).clamp_max(1.0)) + GRAZING_POWER * torch.log(grazing)


def _grazing(x: Tensor) -> Tensor:
    a, b, c, d = GRAZING
    return 1 + x * (a + x * (b + x * (c + x * d)))


def seen_alpha(distribution: EllipticDistribution, w: Vec3) -> Tensor:
    """The round roughness that loses about as much light from `w`: its square is that along w, at the pole the mean."""
    ax, ay = distribution.alphas
    if distribution.alpha_y is None:
        return ax
    x2, y2 = ax * ax, ay * ay
    return torch.sqrt(x2 * (w.x * w.x) + y2 * (w.y * w.y) + (0.5 * (x2 + y2)) * (w.z * w.z))
