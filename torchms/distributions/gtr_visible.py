"""Visible normals of a GTR surface for any γ: the slope's length first, then its azimuth about that of w.

Seen from w, the slope (r cos φ, r sin φ) has density ∝ (w_z + ρ r cos φ)^+ r P22(r). Integrated over φ and then over all
longer slopes, in the terms of gtr_area.py, that is for r > z / ρ

    W = z^+ Q + [Q g + J] / π,   g = τ − z arctan(τ / z),   J = ∫_τ^∞ Q τ² / (τ² + z²) dτ,

and for shorter ones, which are all visible, w_z Q + σ(−|w|), whose inverse is elementary [Burley2012]. J is the integral of
the trigonometric interpolant of the same sum that gives σ. Given r, φ solves Kepler's equation w_z φ + ρ r sin φ = M.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.distributions.gtr_area import Incidence, angles, incidence, rings, stacked
from torchms.maths.frame import Vec3, normalized
from torchms.maths.numerics import horizon, safe_sqrt, smallest
from torchms.maths.ratios import exp_ratio, log_ratio
from torchms.maths.special import constant

MODES = {torch.float32: 32, torch.float64: 48}
"""Terms of the interpolant. γ = 10 at α = 0.01 needs the most: 4e-6 of J is left out in float32, 1e-12 in float64."""
STEPS = {torch.float32: 3, torch.float64: 5}
"""Newton steps for the angle ϑ from the secant of its cell, before the differentiable one."""
HALVINGS, HALLEY_STEPS = 6, 4
"""For Kepler's equation."""
LEAST_ANGLE = 1e-9


class Tail(NamedTuple):
    """W as a function of ϑ, for slopes longer than z / ρ."""

    v: Incidence
    up: Tensor  # max(w_z, 0)
    mean: Tensor  # J = mean ϑ + Σ_k modes_k sin(k ϑ) − peak arctan(t tan(ϑ/2))
    modes: Tensor
    peak: Tensor
    t: Tensor  # tanh(η / 2)

    def detached(self) -> "Tail":
        return Tail(Incidence(*(x.detach() for x in self.v)), *(x.detach() for x in self[1:]))

    @property
    def downward_area(self) -> Tensor:
        """σ(−|w|) = J(π) / π."""
        return self.mean - 0.5 * self.peak

    def at(self, theta: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """W, dW/dϑ, τ and g."""
        s, c = torch.sin(0.5 * theta), torch.cos(0.5 * theta)
        ring = rings(self.v, s, c)
        waves = torch.sin(stacked([float(k) for k in range(1, len(self.modes) + 1)], theta) * theta)
        J = self.mean * theta + (self.modes * waves).sum(0)
        return self._value(J, ring.Q, ring.slope, ring.tau, s, c)

    def on_nodes(self, s: Tensor, c: Tensor, Q: Tensor, tau: Tensor) -> Tensor:
        """W at the midpoints."""
        n = len(s)
        theta = [math.pi * (j + 0.5) / n for j in range(n)]
        waves = torch.tensor([[math.sin(k * x) for k in range(1, n)] for x in theta], dtype=Q.dtype, device=Q.device)
        J = self.mean * stacked(theta, self.mean) + torch.tensordot(waves, self.modes, 1)
        return self._value(J, Q, Q, tau, s, c)[0]

    def _value(self, J: Tensor, Q: Tensor, slope: Tensor, tau: Tensor, s: Tensor, c: Tensor):
        z = self.v.z
        pi = constant(math.pi, tau)
        g = tau - z * torch.atan(tau / z.clamp_min(horizon(z.dtype)))
        J = J - self.peak * torch.atan(self.t * s / c.clamp_min(horizon(z.dtype)))
        each = self.up + g / pi
        return Q * each + J / pi, slope * each, tau, g


def tail_of(v: Incidence) -> tuple[Tail, Tensor]:
    """W, and its values at the midpoints."""
    n = MODES[v.z.dtype]
    s, c = angles(n, v.ell)
    ring = rings(v, s, c)
    # A near pole, at ϑ = π ± i η, is taken off before the interpolation: −(z / 2) sinh η / (cosh η + cos ϑ).
    sinh = v.z * v.p
    t = sinh / torch.sqrt(v.rho2 + sinh * sinh)
    # Where t > ½ it is too far to matter, and its digits would be lost beside it.
    peak = torch.where(t < 0.5, v.z, 0.0)
    f = ring.f + 0.5 * peak * t / (c * c + (t * t) * (s * s))
    rows = [[2 / (n * k) * math.cos(math.pi * k * (j + 0.5) / n) for j in range(n)] for k in range(1, n)]
    modes = torch.tensordot(torch.tensor(rows, dtype=f.dtype, device=f.device), f, 1)
    tail = Tail(v, torch.where(v.below, 0.0, v.z), f.sum(0) / n, modes, peak, t)
    return tail, tail.on_nodes(s, c, ring.Q, ring.tau)


def angle_of(tail: Tail, grid: Tensor, target: Tensor, end: Tensor) -> Tensor:
    """ϑ in (0, π) at which W(ϑ) = `target` < `end` = W(π); differentiable."""
    fixed, goal = tail.detached(), target.detach()
    grid, end = grid.detach(), end.detach()
    n = len(grid)
    step = math.pi / n
    lower = grid < goal
    cell = lower.to(goal.dtype).sum(0)
    low, high = (step * (cell - 0.5)).clamp_min(LEAST_ANGLE), (step * (cell + 0.5)).clamp_max(math.pi)
    before = torch.where(lower, grid, 0.0).amax(0)
    after = torch.minimum(torch.where(lower, end, grid).amin(0), end)
    rise = (after - before).clamp_min(smallest(goal.dtype))
    theta = low + (high - low) * ((goal - before) / rise).clamp(0, 1)
    for _ in range(STEPS[goal.dtype]):
        W, slope, _, _ = fixed.at(theta)
        theta = (theta - (W - goal) / slope.clamp_min(smallest(goal.dtype))).clamp(low, high)
    # The last step is differentiated, with its denominator held: that is the derivative of the inverse function.
    W, slope, _, _ = tail.at(theta)
    move = (W - target) / slope.detach().clamp_min(smallest(goal.dtype) ** 0.5)
    theta = (theta - move.detach()).clamp(low, high)
    return theta - (move - move.detach())


def short_slope(v: Incidence, share: Tensor) -> Tensor:
    """r² of which a `share` < 1 of all slopes is shorter [Burley2012]: the inverse of 1 − Q."""
    # 1 − Q = expm1(k a t) / expm1(k a), with ln(y / α²) = a t; then r² = (y − α²) / (1 − y).
    whole = exp_ratio(v.k * v.a) * share
    x = v.k * v.a * whole
    t = (whole * log_ratio(x, (1 + x).clamp_min(smallest(x.dtype)))).clamp_max(1 - torch.finfo(x.dtype).eps / 2)
    A, B = v.a * t, v.a * (1 - t)
    return torch.exp(-B) * (t * exp_ratio(-A)) / ((1 - t) * exp_ratio(-B))


def kepler(z: Tensor, K: Tensor, M: Tensor, excess: Tensor, top: Tensor) -> Tensor:
    """φ in [0, `top`] with z φ + K sin φ = (M / π) (π z + excess), by value; z + K cos φ ≥ 0 there."""
    goal = M * (z + excess / math.pi)
    low, high = torch.zeros_like(goal), top.expand_as(goal)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        less = z * middle + K * torch.sin(middle) < goal
        low, high = torch.where(less, middle, low), torch.where(less, high, middle)
    phi = 0.5 * (low + high)
    least = smallest(goal.dtype) ** 0.5
    for _ in range(HALLEY_STEPS):
        sin, cos = torch.sin(phi), torch.cos(phi)
        F, first = z * phi + K * sin - goal, (z + K * cos).clamp_min(least)
        phi = (phi - F / (first + 0.5 * F * K * sin / first).clamp_min(least)).clamp(low, high)
    return phi


def visible_normal(alpha: Tensor, gamma: Tensor, w: Vec3, u0: Tensor, u1: Tensor) -> Vec3:
    """A normal with density D(m) ⟨w, m⟩ / σ(w); its gradient is that of the exact inverse."""
    tiny = smallest(u0.dtype)
    # Straight down no facet faces w, and σ is 0: any normal will do.
    nadir = (w.z < 0) & (w.x * w.x + w.y * w.y < tiny**0.5)
    w = Vec3(torch.where(nadir, 1.0, w.x), torch.where(nadir, 0.0, w.y), torch.where(nadir, 0.0, w.z))
    v = incidence(alpha, gamma, w, u0, u1)
    rho = safe_sqrt(v.rho2)
    tail, grid = tail_of(v)
    down = tail.downward_area
    total = tail.up + down
    one = torch.ones_like(v.ell)
    end = tail.up * rings(v, one, torch.zeros_like(one)).Q + down
    target = (1 - u0) * total
    inner = target > end
    # Short slopes, by the share u σ / w_z of all that are shorter.
    share = u0 * total / torch.where(inner, tail.up, 1.0)
    r = safe_sqrt(short_slope(v, torch.where(inner, share, 0.5)))
    theta = angle_of(tail, grid, torch.where(inner, 0.5 * end, target), end)
    _, _, tau, g = tail.at(theta)
    outer = torch.sqrt((tau * tau + v.z * v.z).clamp_min(tiny))

    # The azimuth. M is the position on the circle or arc that is visible, K = ρ r.
    K = torch.where(inner, rho * r, outer)
    pi = constant(math.pi, K)
    arc = torch.atan(tau / v.z.clamp_min(horizon(v.z.dtype)))
    top = torch.where(inner, torch.ones_like(arc) * pi, torch.where(v.below, arc, pi - arc))
    excess = torch.where(inner, 0.0, torch.where(v.below, g + pi * v.z, g))
    tilted = v.rho2 > tiny
    azimuth = torch.where(tilted, torch.atan2(torch.where(tilted, w.y, 0.0), torch.where(tilted, w.x, 1.0)), 0.0)
    # On an arc M counts from w's azimuth, so that the ends move with it; on a circle it turns from there to the x axis
    # as the circle gets uniform, so that the pole, where w has no azimuth, is nothing special.
    e = torch.where(inner, (K / torch.where(inner, v.z, 1.0)).clamp_max(1), 1.0)
    fixed = e * e * e * e
    turn = (2 * u1 - 1) - (1 - fixed) * azimuth / pi
    turn = turn - 2 * torch.round(0.5 * turn)
    M = pi * turn
    negative = M < 0
    phi = kepler(*(x.detach() for x in (w.z, K, M.abs(), excess, top)))
    phi = torch.where(negative, -phi, phi)
    d = phi - M.detach()
    # The differentiable step, for d = φ − M: w_z d + K sin(M + d) = M / π · excess.
    psi = pi * (2 * u1 - 1) + d
    sine = torch.where(tilted, K * torch.sin(M + d), r * (w.x * torch.sin(psi) - w.y * torch.cos(psi)))
    rate = (w.z + K * torch.cos(phi)).detach().clamp_min(1e-3 * tiny**0.25)
    move = (w.z * d + sine - turn * excess) / rate
    psi = psi + fixed * azimuth - (move - move.detach())
    length, height = torch.where(inner, r, outer), torch.where(inner, torch.ones_like(rho), rho)
    return normalized(Vec3(length * torch.cos(psi), length * torch.sin(psi), height))
