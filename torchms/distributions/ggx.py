"""The GGX (Trowbridge–Reitz) distribution."""

import math

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, dot, join, normalized, pair, split
from torchms.maths.numerics import horizon, safe_sqrt, smallest
from torchms.parameters.maps import fitted
from torchms.typing import Direction, Pair, Scalar


class GGX(EllipticDistribution):
    """GGX normals with roughness α_x = `alpha` and α_y = `alpha_y` (isotropic if it is not given) [Walter2007].

    `alpha`, `alpha_y`: float, tensor or per-pixel map (*batch), buffer or `nn.Parameter`, in [1e-3, 2].
    Raises ValueError outside that range.
    """

    sources = ("Walter2007", "Dupuy2023")

    def normal_density(self, m: Vec3) -> Tensor:
        # [Walter2007] Eq. 33, stretched: D = 1 / (π α_x α_y (x²/α_x² + y²/α_y² + z²)²) for a unit m. Multiplying the
        # parenthesis by α_x α_y keeps the powers of a small α apart in float32.
        ax, ay = self.alphas
        ratio = ax / ay
        q = m.x * m.x / ratio + m.y * m.y * ratio + m.z * m.z * (ax * ay)
        up = m.z > 0
        q = torch.where(up, q, 1.0)
        return torch.where(up, (ax * ay) / (math.pi * q * q), 0.0)

    def density_along(self, v: Vec3) -> Tensor:
        # As above, for |v|² in place of 1: no root is needed.
        ax, ay = self.alphas
        ratio = ax / ay
        q = v.x * v.x / ratio + v.y * v.y * ratio + v.z * v.z * (ax * ay)
        up = v.z > math.sqrt(smallest(v.z.dtype))
        stretch = torch.where(up, dot(v, v), 0.0) / torch.where(up, q, 1.0)
        return ax * ay / math.pi * (stretch * stretch)

    def blocking(self, d: Vec3) -> Tensor:
        # σ(−d) / |d_z|, of `projected_area`, as one quotient.
        s = self.stretched(d)
        rho2 = s.x * s.x + s.y * s.y
        up = s.z > 0
        z = s.z.abs()
        far = torch.sqrt((z * z + rho2).clamp_min(smallest(z.dtype))) + z
        return 0.5 * torch.where(up, rho2, far) / (torch.where(up, far, 1.0) * z.clamp_min(horizon(z.dtype)))

    def projected_area(self, w: Vec3) -> Tensor:
        # σ = (r + w_z) / 2, r = √(w_z² + ρ²), ρ² = α_x² x² + α_y² y². Below the horizon the sum cancels; there
        # r + w_z = ρ² / (r − w_z).
        s = self.stretched(w)
        rho2 = s.x * s.x + s.y * s.y
        below = s.z < 0
        # Not abs(): its gradient at the horizon is 0, that of σ is ½.
        far = torch.sqrt((s.z * s.z + rho2).clamp_min(smallest(s.z.dtype))) + torch.where(below, -s.z, s.z)
        return 0.5 * torch.where(below, rho2 / far, far)

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        s = normalized(self.stretched(w))
        return self._normal_on_cap(s, self._cap(s), torch.zeros_like(s.z), u0, u1)

    def _cap(self, s: Vec3) -> Tensor:
        """1 + s_z, the height of the cap z > −s_z, without cancellation below the horizon."""
        return torch.where(s.z < 0, (s.x * s.x + s.y * s.y) / (1 + s.z.abs()), 1 + s.z)

    def _normal_on_cap(self, s: Vec3, cap: Tensor, above: Tensor, u0: Tensor, u1: Tensor) -> Vec3:
        """The normal that reflects `s` into a direction uniform on the cap of height `cap` ≤ 1 + s_z = cap + above."""
        # [Dupuy2023]: in the stretched frame the reflections of w by visible normals are uniform on the cap z > −s_z,
        # also for s_z < 0.
        below_top = u1 * cap
        sin_theta = safe_sqrt(below_top * (2 - below_top))
        phi = (2 * math.pi) * u0
        # m ∝ stretched(reflection + w); the z component is 1 − below_top + s_z.
        height = (1 - u1) * cap + above
        return normalized(
            self.stretched(Vec3(sin_theta * torch.cos(phi) + s.x, sin_theta * torch.sin(phi) + s.y, height))
        )

    # The visible normals that may reflect `w` above the horizon, and few others [Tokuyoshi2023].

    def bound(self, w: Vec3) -> Tensor:
        """k ≤ 1 of the cap z > −k s_z, which holds all stretched reflections that point up; 1 below the horizon."""
        # [Tokuyoshi2023]: s = 1 + |w_xy|, a = min(α_x, α_y, 1), k = (1 − a²) s² / (s² + a² w_z²).
        ax, ay = self.alphas
        a = torch.minimum(ax, ay).clamp_max(1)
        s = 1 + safe_sqrt(w.x * w.x + w.y * w.y)
        s2, a2 = s * s, a * a
        return torch.where(w.z > 0, (1 - a2) * s2 / (s2 + a2 * (w.z * w.z)), 1.0)

    def horizon_bound(self, w: Vec3, phi: Tensor) -> Tensor:
        """Stretched z of the reflection of `w` that lies on the horizon at longitude `phi` [rad]; at least −k s_z."""
        # o on the horizon: m ∝ w + o; the normal of the stretched sphere is m over the stretch; reflect the stretched w.
        s = normalized(self.stretched(w))
        ax, ay = self.alphas
        n = normalized(Vec3((w.x + torch.cos(phi)) / ax, (w.y + torch.sin(phi)) / ay, w.z.expand_as(phi)))
        return 2 * dot(s, n) * n.z - s.z

    def bounded_area(self, w: Vec3) -> Tensor:
        """∫ ⟨w, m⟩ D(m) dm over the bounded normals: (k w_z + r) / 2; σ(w) below the horizon."""
        s = self.stretched(w)
        r = self._length(s)
        # Below the horizon r + w_z cancels: [Tokuyoshi2023] divides by r − w_z, as does projected_area.
        return torch.where(w.z > 0, 0.5 * (self.bound(w) * w.z + r), self.guarded_area(w))

    def bounded_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """A normal with density `bounded_density`."""
        s = normalized(self.stretched(w))
        k = self.bound(w)
        up = w.z > 0
        cap = torch.where(up, 1 + k * s.z, self._cap(s))
        return self._normal_on_cap(s, cap, torch.where(up, (1 - k) * s.z, 0.0), u0, u1)

    def within_bound(self, w: Vec3, m: Vec3) -> Tensor:
        """Whether `m`, a normal of any length, reflects `w` into the cap."""
        ax, ay = self.alphas
        s = self.stretched(w)
        n = Vec3(m.x * ay, m.y * ax, m.z * (ax * ay))
        # 2 (s · n) n_z − s_z ≥ −k s_z for unit s and n, times |s| |n|². A sample at the rim keeps its density.
        rim = (1 - self.bound(w)) * s.z - 4 * torch.finfo(s.z.dtype).eps * self._length(s)
        return 2 * dot(s, n) * n.z >= rim * dot(n, n)

    def _length(self, s: Vec3) -> Tensor:
        return torch.sqrt((s.x * s.x + s.y * s.y + s.z * s.z).clamp_min(smallest(s.z.dtype)))

    def bounded_density(self, w: Vec3, m: Vec3) -> Tensor:
        facing = torch.where(self.within_bound(w, m), dot(w, m).clamp_min(0), 0.0)
        return self.normal_density(m) * facing / self.bounded_area(w)

    def reflecting_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        return self.bounded_normal(w, u0, u1)

    def reflecting_density(self, w: Vec3, v: Vec3) -> Tensor:
        return torch.where(self.within_bound(w, v), self.density_along(v) / (4 * self.bounded_area(w)), 0.0)

    def sample_bounded(self, w: Direction, u: Pair) -> Direction:
        """A normal that may reflect `w` above the horizon, with density `D_bounded`; `u` in [0, 1)².

        Not for refraction: normals that refract but cannot reflect upward are left out. Reflections below the horizon remain,
        but fewer than with `sample_visible`; none if α_x = α_y ≥ 1. For w below the horizon it is `sample_visible`.
        """
        view, (u0, u1) = split(w), pair(u)
        return join(fitted(self, view.z.shape, u0.shape).bounded_normal(view, u0, u1))

    def D_bounded(self, w: Direction, m: Direction) -> Scalar:
        """Density of `sample_bounded` at `m` [1/sr]: D(m) ⟨w, m⟩ over its integral on the cap [Tokuyoshi2023]."""
        view, normal = split(w), split(m)
        return fitted(self, view.z.shape, normal.z.shape).bounded_density(view, normal)
