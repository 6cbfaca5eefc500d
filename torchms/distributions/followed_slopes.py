"""The gradient of slopes that were drawn from a mixture by choosing a component.

At fixed random numbers a choice jumps, and the gradient of what was chosen misses that. Here the slopes move as those of
the one increasing map do that has no choice in it (Knothe and Rosenblatt's): the slope a along w's azimuth keeps its
quantile among the visible ones, then the slope b across keeps its quantile among those of the same a. Both distribution
functions are closed, so that da = −∂F(a) / f(a), and every expectation has its right gradient.
"""

import math

import torch
from torch import Tensor

from torchms.distributions.slope_mixture import Components, seen
from torchms.maths.frame import Vec3
from torchms.maths.numerics import safe_sqrt, smallest
from torchms.maths.special import INV_SQRT_PI, erfc, erfcx


def followed(parts: Components, w: Vec3, p: Tensor, q: Tensor) -> tuple[Tensor, Tensor]:
    """The slopes (p, q), visible from `w`, with the gradient in `w` and in the numbers of the components."""
    # The frame (e, f) of w's azimuth. It turns with w by the share ρ² of the angle, so that neither ρ = 0 nor the edge
    # a = κ, which is met where ρ is near 1, is a pole of the gradient.
    x, y = w.x.detach(), w.y.detach()
    rho = safe_sqrt(x * x + y * y)
    ok = rho > smallest(rho.dtype) ** 0.5
    inverse = 1 / torch.where(ok, rho, 1.0)
    cos, sin = torch.where(ok, x * inverse, 1.0), torch.where(ok, y * inverse, 0.0)
    turn = rho * (w.y * cos - w.x * sin)
    e = (cos - turn * sin, sin + turn * cos)
    f = (-e[1], e[0])
    along, across = w.x * e[0] + w.y * e[1], w.x * f[0] + w.y * f[1]

    # Each component in this frame: means, spreads, and the lean of b's mean with a.
    mean_a, mean_b = parts.x * e[0] + parts.y * e[1], parts.x * f[0] + parts.y * f[1]
    a0, a1 = parts.xx * e[0] + parts.xy * e[1], parts.yy * e[1]
    b0, b1 = parts.xx * f[0] + parts.xy * f[1], parts.yy * f[1]
    spread2 = a0 * a0 + a1 * a1
    spread = torch.sqrt(spread2)
    lean = (a0 * b0 + a1 * b1) / spread2
    narrow = parts.xx * parts.yy / spread

    a, b = (p * e[0] + q * e[1]).detach(), (p * f[0] + q * f[1]).detach()
    s = parts.seen(w)
    area, shift = seen(parts, s)
    # F(a) σ = Σ weight ∫_{a' < a} (w_z − along a' − across b) N(a', b), N a component's density. Where shift > 0, visible
    # slopes have t < 0 and t² ≥ shift; straight down none is.
    t = (a - mean_a) / spread
    peak = INV_SQRT_PI * parts.weight * torch.exp((shift - t * t).clamp_max(0))
    root_pi = math.sqrt(math.pi)
    tail = 0.5 * root_pi * peak * erfcx(t.abs())
    less = torch.where(t > 0, parts.weight - tail, tail)
    mass = (s.z * less + 0.5 * (along + across * lean) * spread * peak).sum(0)
    facing = (w.z - along * a).detach()
    a = _kept(a, mass, area.sum(0), facing * (peak / spread).sum(0))

    # The same of b at this a, whose density is that of the components there, times w_z − along a − across b.
    t = (a - mean_a) / spread
    t2 = t * t
    weight = parts.weight / spread * torch.exp(t2.amin(0) - t2)
    facing = w.z - along * a
    middle = mean_b + lean * (a - mean_a)
    v = (b - middle) / narrow
    peak = INV_SQRT_PI * torch.exp(-v * v)
    sees = facing - across * middle
    mass = (weight * (0.5 * sees * erfc(-v) + 0.5 * across * narrow * peak)).sum(0)
    b = _kept(b, mass, (weight * sees).sum(0), facing * (weight * peak / narrow).sum(0))
    return a * e[0] + b * f[0], a * e[1] + b * f[1]


def _kept(x: Tensor, mass: Tensor, whole: Tensor, density: Tensor) -> Tensor:
    """`x`, with the gradient that it must have for mass / whole to stay; `density`: d mass / dx."""
    density = density.detach()
    ok = density > smallest(density.dtype) ** 0.5
    ok = ok & (whole.detach() > smallest(density.dtype) ** 0.5)
    quantile = torch.where(ok, (mass / torch.where(ok, whole, 1.0)).detach(), 0.0)
    move = torch.where(ok, mass - quantile * whole, 0.0) / torch.where(ok, density, 1.0)
    return x - (move - move.detach())
