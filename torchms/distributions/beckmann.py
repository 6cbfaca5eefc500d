"""The Beckmann distribution: the normals of a Gaussian random surface."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.base import EllipticDistribution
from torchms.maths.frame import Vec3, dot, normalized
from torchms.maths.numerics import horizon, safe_sqrt, smallest
from torchms.maths.special import INV_SQRT_PI, constant, erfcx, erfcx_pair, ierfcx, normal_quantile

# Householder steps (of fourth order) before the last, differentiable Newton step. The largest |F(x) / F(κ) − Φ| that n
# of them leave, over κ in [−50, 1e6] and all quantiles of u in [0, 1): float32 5e-2, 1.1e-6, 1.1e-6 for n = 0, 1, 2;
# float64 5e-2, 8e-10, 2e-15 (torch 2.13, November 2026; tests/unit/distributions/test_beckmann.py holds them to it).
STEPS = {torch.float32: 1, torch.float64: 2}


class SlopeProblem(NamedTuple):
    """Find the slope x along w's azimuth at which a visible slope's distribution function has a given value.

    Seen from w, the slope has density ∝ (κ − x)^+ e^{−x²}, κ = cot θ of the stretched w. The unknown is a distance
    d ≥ 0. From the left (`lower`), x = −k − d with k = max(−κ, 0), and the mass below x is sought; else x = d in
    (0, κ), and the mass above x. Areas are scaled by ρ, the length of the stretched w's horizontal part.
    """

    lower: Tensor
    sign: Tensor  # 1 where `lower`, else −1
    rho: Tensor  # ρ
    top: Tensor  # ρ max(κ, 0) = max(w_z, 0)
    k: Tensor  # max(−κ, 0)
    beyond: Tensor  # what the area beyond x = κ adds to the mass above x; 0 where `lower`
    total: Tensor  # area of all visible slopes
    target: Tensor  # area sought

    def detached(self) -> "SlopeProblem":
        return SlopeProblem(*(part.detach() for part in self))

    def area(self, d: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The area at d, its negated derivative times √π / 2, ρ(κ − x) and k + d."""
        # For x = −t < 0: ∫_{−∞}^x (κ − s) e^{−s²} ds = (√π/2) e^{−t²} [(κ − x) erfcx(t) + ierfcx(t)], and for x ≥ 0 the
        # integral from x to infinity is that with −ierfcx. All is divided by (√π/2) e^{−k²}, so that nothing
        # underflows for steeply descending w.
        t = self.k + d
        signed = self.sign * self.rho
        gap = self.top + signed * d
        e, i = erfcx_pair(t)
        weight = torch.exp(-d * (t + self.k))
        return weight * (gap * e + signed * i) + self.beyond, gap * weight, gap, t


class Beckmann(EllipticDistribution):
    """Beckmann normals with roughness α_x = `alpha` and α_y = `alpha_y` (isotropic if it is not given) [Walter2007].

    The slopes of the surface are Gaussian, with variances α_x² / 2 and α_y² / 2.
    `alpha`, `alpha_y`: float, tensor or per-pixel map (*batch), buffer or `nn.Parameter`, in [1e-3, 2].
    Raises ValueError outside that range.
    """

    sources = ("Walter2007",)

    def normal_density(self, m: Vec3) -> Tensor:
        slope2, scale = self.density_parts(m)
        return torch.exp(-slope2) * scale

    def projected_area(self, w: Vec3) -> Tensor:
        z, below, c2, tail = self.area_parts(w)
        downward = torch.exp(-c2) * tail
        return torch.where(below, downward, z + downward)

    def visible_density(self, w: Vec3, m: Vec3) -> Tensor:
        # D(m) ⟨w, m⟩ / σ(w). Below the horizon D and σ share the factor e^{−c²}, as every visible slope is steeper than
        # w; without it neither underflows. What is left of σ is too small to divide by only for c > 1e4 or so.
        slope2, scale = self.density_parts(m)
        z, below, c2, tail = self.area_parts(w)
        area = torch.where(below, tail, z + torch.exp(-c2) * tail)
        cos = dot(w, m)
        visible = (cos > 0) & (scale > 0) & (area > math.sqrt(smallest(z.dtype)))
        exponent = torch.where(visible, torch.where(below, c2, 0.0) - slope2, 0.0)
        density = torch.exp(exponent) * scale * cos / torch.where(visible, area, 1.0)
        return torch.where(visible, density, 0.0)

    def density_parts(self, m: Vec3) -> tuple[Tensor, Tensor]:
        """The squared stretched slope of m and D e^{slope²}; 0 and 0 at and below the horizon."""
        # [Walter2007] Eq. 25, stretched: D = exp(−(x²/α_x² + y²/α_y²) / z²) / (π α_x α_y z⁴). Below z = 1e-4 it is 0 in
        # float64, too, as α ≤ 2: exp(−1 / (2 z)²) underflows at z = 0.018.
        ax, ay = self.alphas
        up = m.z > 1e-4
        inverse = 1 / torch.where(up, m.z, 1.0)
        p, q = m.x * inverse / ax, m.y * inverse / ay
        inverse2 = inverse * inverse
        scale = inverse2 * inverse2 / (constant(math.pi, m.z) * ax * ay)
        return torch.where(up, p * p + q * q, 0.0), torch.where(up, scale, 0.0)

    def area_parts(self, w: Vec3) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """|w_z|, whether w is below the horizon, c² and what σ(−|w|) is but for its factor e^{−c²}."""
        # [Walter2007]: Λ = (1 / (c √π) − e^{c²} erfc c) e^{−c²} / 2 above the horizon, with c = |w_z| / ρ, and
        # σ(w) = w_z (1 + Λ). So σ(w) − w_z = (ρ/2) e^{−c²} ierfcx(c), which is σ(−w).
        s = self.stretched(w)
        below = s.z < 0
        z = torch.where(below, -s.z, s.z)
        rho2 = s.x * s.x + s.y * s.y
        rho = safe_sqrt(rho2)
        least = horizon(z.dtype)
        # c² is not from c: every rounding of it is multiplied by c² in the exponential.
        return z, below, z * z / rho2.clamp_min(least * least), 0.5 * rho * ierfcx(z / rho.clamp_min(least))

    def visible_normal(self, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
        """A normal with density D(m) ⟨w, m⟩ / σ(w), for `w` anywhere on the sphere.

        Exact: two Gaussian slopes, of which the one along w's azimuth is then moved, at a fixed value of the
        distribution function, to that of the visible slopes. At normal incidence it stays, so the azimuth, which is
        undefined there, does not matter. The gradient is that of the exact inverse (implicit differentiation).
        """
        s = self.stretched(w)
        rho2 = s.x * s.x + s.y * s.y
        z2 = torch.where(s.z > 0, s.z * s.z, 0.0)
        tilted = rho2 > (0.1 * torch.finfo(z2.dtype).eps * z2).clamp_min(smallest(z2.dtype))
        rho = safe_sqrt(rho2)
        inverse = 1 / torch.where(tilted, rho, 1.0)
        cos_phi = torch.where(tilted, s.x * inverse, 1.0)
        sin_phi = torch.where(tilted, s.y * inverse, 0.0)
        g0, g1 = normal_quantile(u0), normal_quantile(u1)
        along = g0 * cos_phi + g1 * sin_phi
        moved = visible_slope(along, rho, s.z) - along
        # The slope moves by −ρ / (2 w_z) + O(ρ²), opposite to w: at normal incidence no azimuth is needed.
        polar = ~tilted & (s.z > 0)
        shift = -0.5 / torch.where(polar, s.z, 1.0)
        ax, ay = self.alphas
        p = g0 + torch.where(polar, shift * s.x, moved * cos_phi)
        q = g1 + torch.where(polar, shift * s.y, moved * sin_phi)
        # m ∝ (−slope_x, −slope_y, 1).
        return normalized(Vec3(-ax * p, -ay * q, torch.ones_like(p)))


def visible_slope(gauss: Tensor, rho: Tensor, z: Tensor) -> Tensor:
    """x at which F(x) / F(κ) = Φ(gauss), F(x) = ∫_{−∞}^x (κ − s)^+ e^{−s²} ds, κ = z / ρ, Φ = (1 + erf) / 2."""
    kappa = z / rho.clamp_min(horizon(z.dtype))
    above = z > 0
    zero = torch.zeros_like(kappa)
    top, k = torch.where(above, z, zero), torch.where(above, zero, -kappa)
    kappa = torch.where(above, kappa, zero)
    i = ierfcx(kappa + k)
    weight = torch.exp(-kappa * kappa)
    beyond = rho * weight * i
    # The whole is 2 z + beyond for κ > 0; for κ ≤ 0 it is ρ ierfcx(k), and there is no area beyond.
    total = 2 * top + beyond
    at_zero = torch.where(above, top + constant(INV_SQRT_PI, z) * rho, total)
    # Φ and 1 − Φ, the lesser one accurate relative to itself, and the score √(−ln Φ).
    left = gauss < 0
    e = erfcx(torch.where(left, -gauss, gauss))
    tail = 0.5 * torch.exp(-gauss * gauss) * e
    phi, rest_phi = torch.where(left, tail, 1 - tail), torch.where(left, 1 - tail, tail)
    minus_log = torch.where(left, gauss * gauss, 0.0) - torch.log(torch.where(left, 0.5 * e, 1 - tail))
    score = safe_sqrt(torch.where(rest_phi < 1e-4, rest_phi * (1 + 0.5 * rest_phi), minus_log).detach())

    lower = ~above | (phi * total < at_zero)
    sign = torch.where(lower, 1.0, -1.0).to(z.dtype)
    target = total * torch.where(lower, phi, rest_phi)
    problem = SlopeProblem(lower, sign, rho, top, k, torch.where(lower, 0.0, beyond), total, target)
    # The steps are taken on values; only the last is differentiated, with its denominator held: that is the derivative
    # of the inverse function.
    fixed, cot = problem.detached(), kappa.detach()
    d = first_guess(fixed, gauss.detach(), score, at_zero.detach(), cot, weight.detach(), i.detach())
    for _ in range(STEPS[d.dtype]):
        d = bounded(d, householder(fixed, d, score), cot, fixed.sign)
    area, slope, _, _ = problem.area(d)
    scale = constant(0.5 * math.sqrt(math.pi), z) / slope.detach().clamp_min(smallest(z.dtype))
    step = scale * (area - problem.target)
    d = bounded(d, step.detach(), cot, fixed.sign) + (step - step.detach())
    return -sign * d - k


def bounded(d: Tensor, step: Tensor, kappa: Tensor, sign: Tensor) -> Tensor:
    """d + step, with the gap κ − x changed by no more than a factor of 2 + 3 κ and d kept positive; d if it is NaN.

    Where F(x) / F(κ) rounds to 1 and the gap is lost, the closed form that the steps start from is better than they.
    """
    gap = kappa + sign * d
    factor = 2 + 3 * kappa
    change = sign * torch.where(torch.isnan(step), 0.0, step)
    change = torch.minimum(torch.maximum(change, gap / factor - gap), gap * factor - gap)
    return (d + sign * change).clamp_min(0)


def first_guess(
    problem: SlopeProblem, gauss: Tensor, score: Tensor, at_zero: Tensor, kappa: Tensor, weight: Tensor, i: Tensor
) -> Tensor:
    """Closed forms for d, exact in the limits κ → 0 and κ → ∞ and near F(x) = F(κ).

    weight = e^{−κ²} and i = ierfcx(|κ|).
    """
    root_pi = constant(math.sqrt(math.pi), gauss)
    # κ ≤ 0. At κ = 0, F(x) / F(0) = e^{−x²}, so d is the score. At x → κ the missing share is d² / (√π ierfcx(k)). For
    # k → ∞ it is a Gamma distribution: F(x) / F(κ) = (1 + 2 k d) e^{−2 k d}.
    root = torch.sqrt(root_pi * i)
    descending = score * root * (1 + 0.5 * problem.k * root * score)
    # κ > 0, x < 0: d = score − κ / (1 + 0.9 score) for a small κ, d = −gauss for a large one.
    span = score + gauss
    left = score - span * kappa / (kappa + span * (1 + 0.9 * score))
    # κ > 0, x ≥ 0: the parabola (κ − x)² of a small κ, the Gaussian of a large one. The gap κ − x is at most that of a
    # density e^{−s²} held at e^{−κ²}, which is exact at its end.
    share = problem.target / (problem.total - at_zero).clamp_min(smallest(gauss.dtype))
    parabola = kappa * (1 - safe_sqrt(share.clamp(0, 1)))
    g = gauss.clamp_min(0)
    p2, g2 = parabola * parabola, g * g
    right = parabola * g / torch.sqrt(torch.sqrt(p2 * p2 + g2 * g2)).clamp_min(smallest(gauss.dtype))
    gap = torch.sqrt(root_pi * problem.target / (problem.rho * weight).clamp_min(smallest(gauss.dtype)))
    right = torch.maximum(right, kappa - gap)
    guess = torch.where(problem.lower, torch.where(problem.top > 0, left, descending), right)
    return guess.clamp_min(smallest(gauss.dtype))


def householder(problem: SlopeProblem, d: Tensor, score: Tensor) -> Tensor:
    """One step of fourth order for √(−ln(area / total)) = score from the left, √area = √target from above."""
    area, slope, gap, t = problem.area(d)
    # Logarithmic derivative of the area, and the second and third derivatives over the first.
    a = -constant(2 * INV_SQRT_PI, d) * slope / area
    pull = problem.rho / gap
    second = problem.sign * pull - 2 * t
    third = second * second - pull * pull - 2
    # R = √(−L), L = ln(area / total): R' = −a / (2 R), and so on.
    L = torch.log(area / problem.total).clamp_max(-smallest(d.dtype))
    R = torch.sqrt(-L)
    psi = 0.5 * a / L
    second_R = second - a - psi
    third_R = third - 3 * a * second + 2 * a * a - 3 * psi * second_R
    newton_R = (R - score) * 2 * R / a
    # S = √area.
    newton_S = 2 * (torch.sqrt(problem.target / area) - 1) / a
    second_S = second - 0.5 * a
    third_S = third - 1.5 * a * second + 0.75 * a * a
    h = torch.where(problem.lower, newton_R, newton_S)
    A = h * torch.where(problem.lower, second_R, second_S)
    B = h * h * torch.where(problem.lower, third_R, third_S)
    return h * (1 + 0.5 * A) / (1 + A + B / 6)
