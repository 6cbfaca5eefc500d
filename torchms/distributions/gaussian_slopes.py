"""Slopes of a Gaussian surface that are seen from a direction: their area, and how one is drawn.

A direction is given stretched: s = (α_x w_x, α_y w_y, w_z) with the slopes in units of the α, of density e^{−x² − y²} / π.
For slopes that are moved by a mean or sheared, s is what ⟨w, m⟩ / m_z = s_z − s_x x − s_y y makes it.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.maths.frame import Vec3
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


class Area(NamedTuple):
    """σ(s) in parts: z + e^{−c²} tail above the horizon, e^{−c²} tail below it."""

    z: Tensor  # |s_z|
    below: Tensor  # whether s_z < 0
    c2: Tensor  # c², the squared slope at which the facets begin, or end, to face s
    tail: Tensor


def gaussian_area(s: Vec3) -> Area:
    """The projected area of the slopes that a stretched direction sees."""
    # [Walter2007]: Λ = (1 / (c √π) − e^{c²} erfc c) e^{−c²} / 2 above the horizon, with c = |w_z| / ρ, and
    # σ(w) = w_z (1 + Λ). So σ(w) − w_z = (ρ/2) e^{−c²} ierfcx(c), which is σ(−w).
    below = s.z < 0
    z = torch.where(below, -s.z, s.z)
    rho2 = s.x * s.x + s.y * s.y
    rho = safe_sqrt(rho2)
    least = horizon(z.dtype)
    # c² is not from c: every rounding of it is multiplied by c² in the exponential.
    return Area(z, below, z * z / rho2.clamp_min(least * least), 0.5 * rho * ierfcx(z / rho.clamp_min(least)))


def visible_slopes(s: Vec3, u0: Tensor, u1: Tensor) -> tuple[Tensor, Tensor]:
    """Slopes (x, y) with density (s_z − s_x x − s_y y)^+ e^{−x² − y²}, for a stretched direction anywhere.

    Exact: two Gaussian slopes, of which the one along s's azimuth is then moved, at a fixed value of the
    distribution function, to that of the visible slopes. At normal incidence it stays, so the azimuth, which is
    undefined there, does not matter. The gradient is that of the exact inverse (implicit differentiation).
    """
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
    p = g0 + torch.where(polar, shift * s.x, moved * cos_phi)
    q = g1 + torch.where(polar, shift * s.y, moved * sin_phi)
    return p, q


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
