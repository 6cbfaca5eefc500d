"""The GGX (Trowbridge–Reitz) distribution."""

import math

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.frame import Vec3, normalized
from torchms.numerics import safe_sqrt, smallest


class GGX(EllipticDistribution):
    """GGX normals with roughness α_x = `alpha` and α_y = `alpha_y` (isotropic if it is not given) [Walter2007].

    `alpha`, `alpha_y`: float, tensor or per-pixel map (*batch), buffer or `nn.Parameter`, in [1e-3, 2].
    Raises ValueError outside that range.
    """

    def normal_density(self, m: Vec3) -> Tensor:
        # [Walter2007] Eq. 33, stretched: D = 1 / (π α_x α_y (x²/α_x² + y²/α_y² + z²)²) for a unit m. Multiplying the
        # parenthesis by α_x α_y keeps the powers of a small α apart in float32.
        ax, ay = self.alphas
        ratio = ax / ay
        q = m.x * m.x / ratio + m.y * m.y * ratio + m.z * m.z * (ax * ay)
        up = m.z > 0
        q = torch.where(up, q, 1.0)
        return torch.where(up, (ax * ay) / (math.pi * q * q), 0.0)

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
        # [Dupuy2023]: in the stretched frame the reflections of w are uniform on the cap z > −w_z, also for w_z < 0.
        s = normalized(self.stretched(w))
        # 1 + w_z without cancellation below the horizon.
        cap = torch.where(s.z < 0, (s.x * s.x + s.y * s.y) / (1 + s.z.abs()), 1 + s.z)
        below_top = u1 * cap
        sin_theta = safe_sqrt(below_top * (2 - below_top))
        phi = (2 * math.pi) * u0
        # m ∝ stretched(reflection + w); the z component 1 − below_top + s_z is (1 − u1) · cap.
        return normalized(
            self.stretched(Vec3(sin_theta * torch.cos(phi) + s.x, sin_theta * torch.sin(phi) + s.y, (1 - u1) * cap))
        )
