"""What every microfacet distribution offers, derived from three functions of its own."""

import math
from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import Tensor

from torchms.maths.frame import Vec3, dot, join, normalized, pair, split
from torchms.maths.numerics import horizon, own_precision, smallest
from torchms.parameters.declared import Parametric, describe
from torchms.parameters.maps import fitted
from torchms.typing import Direction, Pair, Scalar

DERIVED = {
    "normal_density": ("density_along", "visible_density"),
    "projected_area": ("blocking", "guarded_area", "visible_density"),
    "visible_normal": ("reflecting_normal", "reflecting_density"),
}
"""Kernel that a subclass gives → what is derived from it here, and may be a closed form in the subclass."""


class MicrofacetDistribution(Parametric, ABC):
    """Statistics of the microfacet normals of a Smith surface.

    A subclass gives three kernels on component vectors: `normal_density` (D), `projected_area` (what Λ, G1 and the
    visible normals follow from, on the whole sphere) and `visible_normal` (the sampler). Everything else is here. A class
    that writes one of the three anew does not inherit a closed form of what follows from it: that is derived again.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for kernel, derived in DERIVED.items():
            if kernel in vars(cls):
                for name in derived:
                    if name not in vars(cls):
                        setattr(cls, name, vars(MicrofacetDistribution)[name])

    @abstractmethod
    def normal_density(self, m: Vec3) -> Tensor:
        """D(m) [1/sr]: zero for m at or below the horizon."""

    @abstractmethod
    def projected_area(self, w: Vec3) -> Tensor:
        """σ(w) = ∫ ⟨w, m⟩ D(m) dm > 0, the facet area that faces `w`, on the whole sphere.

        It must be accurate relative to itself, also below the horizon where it is small: σ(w) − σ(−w) = w_z.
        """

    @abstractmethod
    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """A normal with density D(m) ⟨w, m⟩ / σ(w), for `w` anywhere on the sphere."""

    @property
    @abstractmethod
    def mean_alpha2(self) -> Tensor:
        """(α_x² + α_y²) / 2: how rough the surface is, for proposals that follow the roughness."""

    # Kernels derived from the three above.

    def blocking(self, d: Vec3) -> Tensor:
        """|Λ(d)| = σ(−d) / |d_z|, accurate relative to itself on the whole sphere.

        [Heitz2016]: Λ(d) = σ(d) / d_z − 1. With σ(d) = σ(−d) + d_z, the numerator is σ(−d) for either sign of d_z.
        The same number is a(−d) = |1 + Λ(−d)|.
        """
        # |d_z| is kept `horizon` away from zero, so that |Λ| is finite at the horizon and so is its gradient.
        return self.projected_area(-d) / d.z.abs().clamp_min(horizon(d.z.dtype))

    def signed_lambda(self, w: Vec3) -> Tensor:
        """Λ(w): positive above the horizon, below −1 or equal beneath it."""
        magnitude = self.blocking(w)
        return torch.where(w.z < 0, -magnitude, magnitude)

    def visible_density(self, w: Vec3, m: Vec3) -> Tensor:
        """D_w(m) = D(m) ⟨w, m⟩ / σ(w); 0 for a w so near to straight down that σ(w)² is lost."""
        area = self.projected_area(w)
        ok = area > math.sqrt(smallest(area.dtype))
        facing = torch.where(ok, dot(w, m).clamp_min(0), 0.0)
        return self.normal_density(m) * facing / torch.where(ok, area, 1.0)

    def guarded_area(self, w: Vec3) -> Tensor:
        """σ(w), kept so far above zero that D / σ² is finite, which the gradient of D / σ needs.

        It is smaller only for directions that rise steeply out of the surface, where σ(w) is also the probability, next to
        1, that a facet is met at all.
        """
        return self.projected_area(w).clamp_min(1e-12 if w.z.dtype == torch.float32 else 1e-80)

    def reflecting_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """A normal to reflect `w` about, where only reflections above the horizon are of use."""
        return self.visible_normal(w, u0, u1)

    def density_along(self, v: Vec3) -> Tensor:
        """D in the direction of `v`, a vector of any length; 0 for one too short to have a direction."""
        return self.normal_density(normalized(v))

    def reflecting_density(self, w: Vec3, v: Vec3) -> Tensor:
        """Density [1/sr] of the reflection of `w` about `reflecting_normal`, by a vector `v` of any length along its normal."""
        return self.density_along(v) / (4 * self.guarded_area(w))

    # The public surface.

    def D(self, m: Direction) -> Scalar:
        """Density of microfacet normals at `m` [1/sr]: ∫ D(m) m_z dm = 1; zero at and below the horizon."""
        components = split(m)
        return fitted(self, components.z.shape).normal_density(components)

    def Lambda(self, w: Direction) -> Scalar:
        """Smith's Λ at `w`, signed, on the whole sphere: Λ(−w) = −1 − Λ(w) [Heitz2016].

        Closer to the horizon than |w_z| = 1e-7 (float32; 1e-14 in float64), where Λ diverges, it is that of this
        w_z; exactly at the horizon it is positive.
        """
        components = split(w)
        return fitted(self, components.z.shape).signed_lambda(components)

    def D_visible(self, w: Direction, m: Direction) -> Scalar:
        """Density of the normals visible from `w`, at `m` [1/sr]; integrates to 1 over m for any `w` on the sphere."""
        view, normal = split(w), split(m)
        return fitted(self, view.z.shape, normal.z.shape).visible_density(view, normal)

    def sample_visible(self, w: Direction, u: Pair) -> Direction:
        """A visible normal for any `w` on the sphere, with density `D_visible`; `u` (*batch, 2) in [0, 1)²."""
        with own_precision(u):
            view, (u0, u1) = split(w), pair(u)
            return join(fitted(self, view.z.shape, u0.shape).visible_normal(view, u0, u1))

    def extra_repr(self) -> str:
        return describe(self)


class EllipticDistribution(MicrofacetDistribution):
    """A distribution whose slopes are a round one, stretched by α_x along x and α_y along y."""

    alpha: Tensor
    alpha_y: Tensor | None
    limits = (1e-3, 2.0)

    def __init__(self, alpha: float | Tensor, alpha_y: float | Tensor | None = None) -> None:
        super().__init__()
        low, high = self.limits
        remedy = (
            f"A mirror is the limit alpha -> 0: take {low:g}; nothing is rougher than {high:g}. "
            "A roughness of another program becomes an alpha by "
            'torchms.alpha(roughness, "gltf").'
        )
        self.declare("alpha", alpha, low=low, high=high, remedy=remedy)
        self.declare("alpha_y", alpha_y, low=low, high=high, remedy=remedy, optional=True)

    @property
    def alphas(self) -> tuple[Tensor, Tensor]:
        """α_x and α_y; they are one tensor if the distribution is isotropic."""
        return self.alpha, self.alpha if self.alpha_y is None else self.alpha_y

    @property
    def mean_alpha2(self) -> Tensor:
        ax, ay = self.alphas
        return (ax * ax + ay * ay) / 2

    def stretched(self, v: Vec3) -> Vec3:
        """(α_x v_x, α_y v_y, v_z)."""
        ax, ay = self.alphas
        return Vec3(ax * v.x, ay * v.y, v.z)
