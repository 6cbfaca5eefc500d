"""Energy of one bounce off a rough surface, from a table: E of a direction, and its mean E_avg."""

from importlib import resources
from pathlib import Path

import torch
from torch import Tensor, nn

from torchms.approximations import coordinates as at
from torchms.approximations.chebyshev import contracted, outer, polynomials, summed
from torchms.distributions.base import EllipticDistribution, MicrofacetDistribution
from torchms.maths.frame import Vec3
from torchms.storage.archives import read_versioned, scalar, single
from torchms.version import __version__

FORMAT = 1
"""Version of the files: of the coordinates and of what the coefficients multiply."""

SHAPES: dict[str, tuple[int, ...]] = {
    "loss": (7, 21, 19, 8),  # harmonic, direction, size, shape
    "mean": (28, 9),  # size, shape
    "glass_loss": (2, 31, 13, 8),  # side, direction, size, eta
    "glass_mean": (2, 28, 9),  # side, size, eta
}
"""Coefficients of each series."""

KNOWN = ("GGX", "Beckmann")
MOST_BYTES = 4 << 20
REMEDY = "Write it again: python -m tools.generate_tables, in the repository."


def provenance(name: str) -> str:
    """What a file says about where it comes from."""
    return (
        f"torchms {__version__}, torch {torch.__version__}; "
        f"python -m tools.generate_tables {name}; single bounce of torchms, float64 quadrature "
        "(reflection) and 4096 scrambled Sobol points (dielectric), Chebyshev series rounded to float32"
    )


class AlbedoTable(nn.Module):
    """What one bounce loses, 1 − E, on rough surfaces of one kind of distribution, as Chebyshev series.

    `loss` and `mean_loss` are for facets with F = 1: any α_x, α_y of the distribution's range, any direction above the
    horizon. `glass_loss` and `glass_mean_loss` are for reflection and refraction together, α_x = α_y, relative index in
    [1/3, 3]. Everything is differentiable in the direction, the roughness and the index.
    Error of E for F = 1: below 1e-4 where α_x = α_y; root mean square 1e-4 and below 1e-3 for any anisotropy. Error for
    glass: 1e-3 in the median, up to 0.04 near grazing incidence and total reflection. E_avg is the mean of the same series.
    Raises ValueError for coefficients of other shapes, or that are not finite.
    """

    def __init__(self, distribution: str, coefficients: dict[str, Tensor]) -> None:
        super().__init__()
        if distribution not in KNOWN:
            raise ValueError(f"AlbedoTable(distribution=...) must be one of {', '.join(KNOWN)}; got {distribution!r}.")
        self.distribution = distribution
        for name, shape in SHAPES.items():
            if name not in coefficients:
                raise ValueError(f"AlbedoTable(coefficients=...) lacks {name!r}. {REMEDY}")
            value = coefficients[name]
            if tuple(value.shape) != shape:
                raise ValueError(f"AlbedoTable: {name!r} must have shape {shape}; got {tuple(value.shape)}. {REMEDY}")
            if not bool(value.isfinite().all()):
                raise ValueError(f"AlbedoTable: {name!r} holds NaN or infinity. {REMEDY}")
        # The table comes from a file, not from training: it is no part of a state_dict.
        for name in SHAPES:
            self.register_buffer(f"c_{name}", coefficients[name].flatten(-2), persistent=False)
        # α_x = α_y: no harmonics, and T_k(q² = 0) = T_k(−1) = (−1)^k.
        sign = torch.where(torch.arange(SHAPES["loss"][-1]) % 2 == 0, 1.0, -1.0)
        self.register_buffer("c_round", (coefficients["loss"][0] * sign).sum(-1), persistent=False)

    c_loss: Tensor
    c_mean: Tensor
    c_glass_loss: Tensor
    c_glass_mean: Tensor
    c_round: Tensor

    @classmethod
    def load(cls, path: str | Path) -> "AlbedoTable":
        """The table in the file `path`, float32.

        Raises FileNotFoundError for none, ValueError for a file of another format, truncated, or that holds NaN or
        other shapes; nothing is unpickled, and no array is read before its size is known to fit.
        """
        return cls(*_read(Path(path)))

    @classmethod
    def packaged(cls, distribution: str) -> "AlbedoTable":
        """The table that comes with torchms."""
        with resources.as_file(resources.files("torchms.approximations") / f"{distribution.lower()}.npz") as path:
            return cls.load(path)

    def check(self, distribution: MicrofacetDistribution, owner: str) -> None:
        """Raise ValueError if the table is not about that distribution."""
        kind = type(distribution).__name__
        if not isinstance(distribution, EllipticDistribution) or kind != self.distribution:
            raise ValueError(f"{owner}: its table is of {self.distribution}; got {kind}. Use {self.distribution}(...).")

    def loss(self, distribution: MicrofacetDistribution, w: Vec3) -> Tensor:
        """Kernel: 1 − E(w) [1] of facets with F = 1, at least 0."""
        ax, ay, isotropic = self._alphas(distribution)
        view = at.view(w, ax, ay, self._root)
        t = polynomials(2 * view.t - 1, SHAPES["loss"][1] - 1)
        m = (ax + ay) / 2
        size = polynomials(at.size_axis(m), SHAPES["loss"][2] - 1)
        if isotropic:
            return (view.p * summed(contracted(self.c_round, size), t)).clamp_min(0)
        q = (ax - ay) / (ax + ay)
        basis = outer(size, polynomials(at.shape_axis(q), SHAPES["loss"][3] - 1))
        series = contracted(self.c_loss, basis)
        # Re and Im of (s_x + i s_y)^{2l}, by recurrence: smooth at the pole, where an azimuth is not.
        re, im = view.x * view.x - view.y * view.y, 2 * view.x * view.y
        total, c, s = summed(series[0], t), q * re, q * im
        for k in range(1, len(series)):
            total = total + c * summed(series[k], t)
            c, s = q * (c * re - s * im), q * (s * re + c * im)
        return (view.p * total).clamp_min(0)

    def mean_loss(self, distribution: MicrofacetDistribution) -> Tensor:
        """Kernel: 1 − E_avg = 2 ∫ (1 − E) μ dμ, mean over the azimuth, of facets with F = 1."""
        ax, ay, _ = self._alphas(distribution)
        q = (ax - ay) / (ax + ay)
        size = polynomials(at.log_axis((ax + ay) / 2), SHAPES["mean"][0] - 1)
        return torch.exp(contracted(self.c_mean, outer(size, polynomials(at.shape_axis(q), SHAPES["mean"][1] - 1))))

    def glass_loss(self, distribution: MicrofacetDistribution, w: Vec3, eta: Tensor, side: Tensor) -> Tensor:
        """Kernel: 1 − E(w) of one reflection or refraction.

        w is in the frame of its `side`, +1 outside and −1 inside; eta = n_inside / n_outside.
        """
        ax, ay, _ = self._alphas(distribution)
        view = at.view(w, ax, ay, self._root)
        t = polynomials(2 * view.t - 1, SHAPES["glass_loss"][1] - 1)
        size = polynomials(at.size_axis((ax + ay) / 2), SHAPES["glass_loss"][2] - 1)
        series = contracted(self.c_glass_loss, outer(size, self._index(eta, SHAPES["glass_loss"][3])))
        into_denser = (eta > 1) == (side > 0)
        return (view.p * torch.where(into_denser, summed(series[0], t), summed(series[1], t))).clamp_min(0)

    def glass_mean_loss(self, distribution: MicrofacetDistribution, eta: Tensor, side: Tensor) -> Tensor:
        """Kernel: the mean of `glass_loss` over the hemisphere of that side."""
        ax, ay, _ = self._alphas(distribution)
        size = polynomials(at.log_axis((ax + ay) / 2), SHAPES["glass_mean"][1] - 1)
        series = contracted(self.c_glass_mean, outer(size, self._index(eta, SHAPES["glass_mean"][2])))
        return torch.exp(torch.where((eta > 1) == (side > 0), series[0], series[1]))

    @property
    def _root(self) -> bool:
        return at.SQUARE_ROOT[self.distribution]

    def _alphas(self, distribution: MicrofacetDistribution) -> tuple[Tensor, Tensor, bool]:
        assert isinstance(distribution, EllipticDistribution)
        return *distribution.alphas, distribution.alpha_y is None

    def _index(self, eta: Tensor, n: int) -> Tensor:
        return polynomials(at.eta_axis(eta), n - 1)

    def extra_repr(self) -> str:
        return repr(self.distribution)


def _read(path: Path) -> tuple[str, dict[str, Tensor]]:
    """Distribution and coefficients of a file; ValueError if it is not what the generator writes."""
    arrays = read_versioned(path, MOST_BYTES, FORMAT, "albedos", REMEDY)
    otherwise = f"{path.name} is no albedo table"
    name = str(scalar(arrays, "distribution", otherwise, REMEDY))
    missing = [key for key in SHAPES if key not in arrays]
    if missing:
        raise ValueError(f"{otherwise}: it lacks {', '.join(missing)}. {REMEDY}")
    return name, {key: torch.from_numpy(single(arrays[key], key, path.name, REMEDY)) for key in SHAPES}
