"""BRDFs of the RGL material database [DupuyJakob2018]."""

import math
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from torchms.evaluation.arguments import check_values
from torchms.maths.frame import Vec3, check_direction, half_vector, split
from torchms.maths.numerics import safe_sqrt
from torchms.measured.grid import Density, Stack, bilinear
from torchms.measured.tensor_file import read_tensor_file
from torchms.typing import Direction, Spectrum

NEEDED = ("phi_i", "theta_i", "sigma", "ndf", "vndf", "rgb", "jacobian")
ROWS = 1 << 16
"""Rows that are evaluated at a time: a row reads some hundred numbers of the tables."""


class MeasuredBRDF(nn.Module):
    """A measured isotropic surface in linear sRGB: f · |cos θ_o| [1/sr] as it was measured, 0 below the horizon.

    Like a BSDF, `forward(wi, wo)` takes unit vectors in the local frame. `MeasuredBRDF.load(path)` reads a file of
    rgl.epfl.ch/materials (CC0), of the kind that ends in `_rgb.bsdf`. A colour outside of sRGB has a negative channel. What was
    measured above about 75° is unreliable. Source: [DupuyJakob2018].
    """

    theta: Tensor
    sigma: Tensor
    ndf: Tensor
    rgb: Tensor
    vndf: Density

    def __init__(self, fields: dict[str, NDArray], name: str = "fields") -> None:
        super().__init__()
        checked = _checked(fields, name)
        self.description = _text(fields.get("description"))
        self.jacobian = bool(fields["jacobian"].item())
        self.vndf = Density(torch.from_numpy(np.array(checked.pop("vndf"))))
        for key, field in checked.items():
            self.register_buffer(key, torch.from_numpy(np.array(field)))

    @classmethod
    def load(cls, path: str | Path) -> "MeasuredBRDF":
        """The file's BRDF. Raises ValueError, which names file and field, for one that is no isotropic `_rgb.bsdf`."""
        return cls(read_tensor_file(path), Path(path).name)

    @property
    def n_channels(self) -> int:
        """3: red, green and blue."""
        return self.rgb.shape[1]

    def forward(self, wi: Direction, wo: Direction) -> Spectrum:
        """f(wi, wo) · |cos θ_o| [1/sr], (*batch, 3); differentiable in the directions but at the grids' lines."""
        check_direction(wi, "wi")
        check_direction(wo, "wo")
        batch = torch.broadcast_shapes(wi.shape, wo.shape)
        a, b = (w.expand(batch).reshape(-1, 3).to(self.ndf.dtype) for w in (wi, wo))
        check_values(None, {"wi": wi, "wo": wo}, None)
        parts = [self._value(split(x), split(y)) for x, y in zip(a.split(ROWS), b.split(ROWS), strict=True)]
        return torch.cat(parts).reshape(*batch[:-1], self.n_channels)

    def _value(self, wi: Vec3, wo: Vec3) -> Tensor:
        served = (wi.z > 0) & (wo.z > 0)
        wm = half_vector(wi, wo)
        theta_i, phi_i = _angles(wi)
        theta_m, phi_m = _angles(wm)
        # On the grids' second axis φ runs from −π to π.
        x = _u(theta_m)
        turn = (phi_m - phi_i) / (2 * math.pi) + 0.5
        y = turn - turn.detach().floor()
        stack = Stack(self.theta, theta_i)
        value = bilinear(self.rgb, *self.vndf.square(x, y, stack), stack)
        if self.jacobian:
            area = bilinear(self.sigma, _u(theta_i), phi_i / (2 * math.pi) + 0.5)
            value = value * (bilinear(self.ndf, x, y) / (4 * area))
        return torch.where(served, value, 0.0).movedim(0, -1)

    def extra_repr(self) -> str:
        return repr(self.description)


def _u(theta: Tensor) -> Tensor:
    """Where θ stands on a grid: nodes are dense about the normal."""
    return safe_sqrt(theta * (2 / math.pi))


def _angles(w: Vec3) -> tuple[Tensor, Tensor]:
    """θ and φ; at the pole, which has no azimuth, with gradients of zero."""
    rho2 = w.x * w.x + w.y * w.y
    tilted = rho2 > 0
    rho = torch.sqrt(torch.where(tilted, rho2, 1.0))
    theta = torch.where(tilted, torch.atan2(rho, w.z), 0.0)
    return theta, torch.atan2(torch.where(tilted, w.y, 0.0), torch.where(tilted, w.x, 1.0))


def _text(field: NDArray | None) -> str:
    return "" if field is None else field.astype(np.uint8).tobytes().decode("utf-8", "replace").rstrip("\0")


def _checked(fields: dict[str, NDArray], name: str) -> dict[str, NDArray]:
    """The tables by the names of the buffers; ValueError if they are no isotropic BRDF in RGB."""
    if "rgb" not in fields and "spectra" in fields:
        raise ValueError(f"{name} is spectral; this reads RGB. Take the file that ends in _rgb.bsdf.")
    missing = [key for key in NEEDED if key not in fields]
    if missing:
        raise ValueError(f"{name} is no BRDF of the RGL database: it lacks {', '.join(missing)}.")
    n = fields["theta_i"].size
    if fields["phi_i"].size != 1:
        raise ValueError(f"{name} is anisotropic, with {fields['phi_i'].size} azimuths; this reads isotropic files.")
    shapes = {"theta_i": (n,), "sigma": (2, None), "ndf": (2, None), "vndf": (1, n, None, None), "jacobian": (1,)}
    shapes["rgb"] = (1, n, 3, None, None)
    for key, shape in shapes.items():
        found = fields[key].shape
        fits = len(found) == len(shape) and all(b is None or a == b for a, b in zip(found, shape, strict=True))
        if not fits or min(found, default=0) < 1 or (key in ("vndf", "rgb") and min(found[-2:]) < 2):
            wanted = tuple("*" if axis is None else axis for axis in shape)
            raise ValueError(f"{name}: {key!r} is {found}; it must be {wanted}.")
        kind = fields[key].dtype
        if key != "jacobian" and (kind != np.float32 or not np.isfinite(fields[key]).all()):
            raise ValueError(f"{name}: {key!r} must hold finite float32 numbers; got {kind}.")
    theta, vndf = fields["theta_i"], fields["vndf"][0]
    if not (theta[0] >= 0 and theta[-1] < 1.6 and (np.diff(theta) > 0).all()):
        raise ValueError(f"{name}: 'theta_i' must increase within [0, pi / 2]; got {theta}.")
    if not ((vndf >= 0).all() and (vndf.sum((-1, -2)) > 0).all() and (fields["sigma"] > 0).all()):
        raise ValueError(f"{name}: 'vndf' must hold densities, none of them all zero, and 'sigma' areas above 0.")
    return {"theta": theta, "sigma": fields["sigma"], "ndf": fields["ndf"], "vndf": vndf, "rgb": fields["rgb"][0]}
