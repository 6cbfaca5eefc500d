"""A distribution of slopes that was measured: of a height map, of slopes or of a histogram of them."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchms.distributions.base import MicrofacetDistribution
from torchms.distributions.followed_slopes import followed
from torchms.distributions.gaussian_slopes import visible_slopes
from torchms.distributions.slope_mixture import Components, chosen, seen, slope_density
from torchms.maths.frame import Vec3, dot, normalized
from torchms.maths.numerics import differentiated, smallest
from torchms.slopes import file
from torchms.slopes.heights import Spacing, checked_heights, checked_spacing, facet_slopes
from torchms.slopes.mixture import Mixture, checked, mixture
from torchms.slopes.moments import of_histogram, of_slopes

COMPONENTS = 16
"""Most components that a distribution is made of unless others are asked for."""
STEEPEST = 1e-4
"""Least m_z of a facet: D is 0 beneath, where its slopes would be above 1e4."""


class Tabulated(MicrofacetDistribution):
    """Any distribution of slopes, as a mixture of up to 256 Gaussians: not round, skewed, of several peaks or of long tails.

    Each component is a Beckmann surface, sheared and tilted, so that D, Λ on the whole sphere and visible normals from any
    direction are closed forms of the same numbers: exact, smooth, with gradients, in every estimator. A grid of values has
    no closed Λ or visible normals, and jumps where cells meet. Slopes need not be centrally symmetric: Smith's theory asks
    for a level surface only, whose slopes have the mean 0, and a surface seen from its other side has the same slopes.

    weights (K,), means (K, 2) and covariances (K, 2, 2) of the components' slopes (dz/dx, dz/dy); weights are scaled to
    sum to 1. `from_heights`, `from_slopes` and `from_histogram` find them, `Heightfield.distribution()` is that of a
    surface. scale, scale_y: factors of all slopes along x and y (both `scale` if `scale_y` is not given), in [0.01, 100]:
    float, tensor or per-pixel map (*batch), buffer or `nn.Parameter`.
    Raises ValueError for numbers that make no distribution, and says which.
    """

    sources = ("Walter2007",)
    most_at_once = 1 << 14  # each of them takes the terms of a sum

    table: Tensor
    scale: Tensor
    scale_y: Tensor | None

    def __init__(
        self,
        weights: Any,
        means: Any,
        covariances: Any,
        scale: float | Tensor = 1.0,
        scale_y: float | Tensor | None = None,
    ) -> None:
        super().__init__()
        made = checked(weights, means, covariances, type(self).__name__)
        # 2 C = A Aᵀ: a Gaussian of covariance C is one of e^{−|t|²} / π behind A.
        A = np.linalg.cholesky(2 * made.covariances)
        rows = [made.weights, *made.means.T, A[:, 0, 0], A[:, 1, 0], A[:, 1, 1]]
        self.register_buffer("table", torch.from_numpy(np.stack(rows)).to(torch.get_default_dtype()))
        remedy = "It multiplies all slopes, as a factor of the heights does."
        self.declare("scale", scale, low=1e-2, high=1e2, remedy=remedy)
        self.declare("scale_y", scale_y, low=1e-2, high=1e2, remedy=remedy, optional=True)

    @classmethod
    def from_heights(
        cls, heights: Any, spacing: Spacing, *, periodic: bool = False, components: int = COMPONENTS
    ) -> "Tabulated":
        """Of a height map: `heights[i, j]` at (i · dx, j · dy), in the unit of `spacing` = dx or (dx, dy).

        The slopes are those of the two facets of each cell; the mean slope is taken off. periodic: the map repeats.
        Raises ValueError for heights that are not a finite array of at least 4 × 4, for a spacing not above 0, or slopes that
        are all but equal along some direction.
        """
        name = f"{cls.__name__}.from_heights"
        h = checked_heights(np.asarray(heights), f"{name}(heights=...)")
        slopes = facet_slopes(h, checked_spacing(spacing, f"{name}(spacing=...)"), periodic)
        return cls(*mixture(of_slopes(slopes, None, name), components, name))

    @classmethod
    def from_slopes(cls, slopes: Any, weights: Any = None, *, components: int = COMPONENTS) -> "Tabulated":
        """Of slopes (n, 2), dz/dx and dz/dy, as those of a normal map (−m_x/m_z, −m_y/m_z); the mean slope is taken off.

        weights: (n,), how much of the surface, seen from above, has each. Raises ValueError for what is not finite.
        """
        name = f"{cls.__name__}.from_slopes"
        return cls(*mixture(of_slopes(slopes, weights, name), components, name))

    @classmethod
    def from_histogram(
        cls, counts: Any, edges_x: Any, edges_y: Any = None, *, components: int = COMPONENTS
    ) -> "Tabulated":
        """Of a histogram (n_x, n_y) of slopes, as `numpy.histogram2d` gives it; the mean slope is taken off.

        edges_x, edges_y: the edges of the bins, in any widths; `edges_x` for both if the second is not given. What lies
        outside is not known to it. Raises ValueError for edges that do not increase, or counts below 0.
        """
        name = f"{cls.__name__}.from_histogram"
        edges = (edges_x, edges_x if edges_y is None else edges_y)
        return cls(*mixture(of_histogram(counts, edges, name), components, name))

    @classmethod
    def load(cls, path: str | Path) -> "Tabulated":
        """What `save` wrote. Raises FileNotFoundError for no file, ValueError for one that holds something else."""
        return cls(*file.read(path))

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the distribution to `path` (.npz), whole or not at all, with its scale multiplied in.

        Raises FileExistsError if there is a file and not `force`, ValueError for a map of scales.
        """
        file.write(path, self.mixture, force)

    @property
    def mixture(self) -> Mixture:
        """Weights (K), means (K, 2) and covariances (K, 2, 2) of the slopes, `scale` included, in float64.

        Raises ValueError if the scale is a map.
        """
        if any(s.numel() != 1 for s in self.scales):
            raise ValueError(f"{type(self).__name__}(scale=...) is a map: there are as many distributions.")
        parts = Components.of(self.table.detach().double(), 0)
        weight, x, y, xx, xy, yy = (part.cpu().numpy() for part in parts)
        S = np.array([float(s.detach()) for s in self.scales])
        A = np.stack([np.stack([xx, 0 * xx], -1), np.stack([xy, yy], -1)], -2) * S[:, None]
        return Mixture(weight, np.stack([x, y], -1) * S, A @ A.swapaxes(1, 2) / 2)

    @property
    def scales(self) -> tuple[Tensor, Tensor]:
        """Factors of the slopes along x and y."""
        return self.scale, self.scale if self.scale_y is None else self.scale_y

    @property
    def alphas(self) -> tuple[Tensor, Tensor]:
        """α_x and α_y of the Beckmann surface with the same variances of slopes, scale included."""
        weight, x, y, xx, xy, yy = Components.of(self.table, 0)
        sx, sy = self.scales
        variances = 2 * x * x + xx * xx, 2 * y * y + xy * xy + yy * yy
        ax, ay = (torch.sqrt((weight * v).sum()) for v in variances)
        return sx * ax, sy * ay

    @property
    def mean_alpha2(self) -> Tensor:
        ax, ay = self.alphas
        return (ax * ax + ay * ay) / 2

    def _seen(self, w: Vec3, *others: Tensor) -> tuple[Components, Vec3]:
        """The components beside `w`, and w with the scales in it instead of in the slopes."""
        sx, sy = self.scales
        stretched = Vec3(sx * w.x, sy * w.y, w.z)
        return Components.of(self.table, max(x.ndim for x in (*stretched, *others)), stretched.x.dtype), stretched

    def _slope_density(self, m: Vec3, shift: Tensor | float) -> Tensor:
        """D(m) e^{shift}."""
        sx, sy = self.scales
        up = m.z > STEEPEST
        inverse = 1 / torch.where(up, m.z, 1.0)
        p, q = -m.x * inverse / sx, -m.y * inverse / sy
        shift = torch.where(up, shift, 0.0)
        density = slope_density(Components.of(self.table, max(p.ndim, q.ndim, shift.ndim), p.dtype), p, q, shift)
        inverse2 = inverse * inverse
        return torch.where(up, density * (inverse2 * inverse2 / (sx * sy)), 0.0)

    def normal_density(self, m: Vec3) -> Tensor:
        return self._slope_density(m, 0.0)

    def projected_area(self, w: Vec3) -> Tensor:
        parts, s = self._seen(w)
        areas, shift = seen(parts, parts.seen(s))
        return areas.sum(0) * torch.exp(-shift)

    def visible_density(self, w: Vec3, m: Vec3) -> Tensor:
        # D and σ share the factor e^{−shift}: without it neither underflows.
        parts, s = self._seen(w)
        areas, shift = seen(parts, parts.seen(s))
        area, cos = areas.sum(0), dot(w, m)
        visible = (cos > 0) & (area > smallest(area.dtype) ** 0.5)
        upright = Vec3(*(torch.where(visible, x, y) for x, y in zip(m, (0.0, 0.0, 1.0), strict=True)))
        density = self._slope_density(upright, torch.where(visible, shift, 0.0))
        return torch.where(visible, density * cos / torch.where(visible, area, 1.0), 0.0)

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """A normal with density D(m) ⟨w, m⟩ / σ(w), for `w` anywhere on the sphere.

        Exact: a component by its share of what is visible, then a visible slope of it. The choice jumps at fixed random
        numbers, so the gradient is that of another map, which has no choice, at the same normal; there is none in u.
        """
        sx, sy = self.scales
        parts, s = self._seen(w, u0, u1)
        directions = parts.seen(s)
        mask, rest = chosen(seen(parts, directions).areas, u0)
        one = parts.picked(mask)
        x, y = visible_slopes(Vec3(*(torch.where(mask, v, 0.0).sum(0) for v in directions)), rest, u1)
        p, q = one.x + one.xx * x, one.y + one.xy * x + one.yy * y
        if differentiated(*s, self.table, self.scale):
            p, q = followed(parts, s, p, q)
        return normalized(Vec3(-sx * p, -sy * q, torch.ones_like(p)))
