"""The error functions and the Beta function, in polynomials that vectorise and export.

No `erfinv`, `erfc`, `erfcx`, `lgamma`, `log1p` or `expm1` op: ONNX lacks them or has them with large relative errors.
float32 and float64 have polynomials of their own. Gradients are those of the polynomials.
"""

import math

import torch
from torch import Tensor

from torchms.maths.numerics import log1p

# The tables below: `python -m tools.generate_special`, mpmath 1.3.0, November 2026; highest power first.
# Tables: begin.
ERFCX = {
    torch.float32: (
        -0.0287375889,
        0.00553106019,
        0.0675113789,
        -0.0211929592,
        -0.122812446,
        0.107304088,
        0.181482728,
        -0.54799836,
        0.726263242,
        -0.643721543,
        0.421612726,
    ),
    torch.float64: (
        0.0075917957943490948,
        0.0052535039050631611,
        -0.01499178127930552,
        -0.015456245866449653,
        0.011759721520506815,
        0.023779239215168407,
        0.00050153887528459416,
        -0.025788441081631611,
        -0.015390071887282975,
        0.022141369869394232,
        0.029902756844020764,
        -0.016001594748703392,
        -0.046123718247292725,
        0.011941483301351541,
        0.071955871641338129,
        -0.02248746469813086,
        -0.12336091028513046,
        0.1074309670953873,
        0.18151392085670029,
        -0.54800366478752741,
        0.72626258663689105,
        -0.6437214795513187,
        0.42161272812228722,
    ),
}
IERFCX = {
    torch.float32: (
        -0.0316468375,
        -0.0525842486,
        0.0588972983,
        0.110558401,
        -0.0920273322,
        -0.155938773,
        0.202829125,
        0.127739779,
        -0.511005352,
        0.600159888,
        -0.402741137,
        0.148694689,
    ),
    torch.float64: (
        -0.023453623010821088,
        0.014098545826434138,
        0.066706039590971494,
        -0.01300402929597268,
        -0.09262688927720624,
        -0.020236213509771268,
        0.080236346525615661,
        0.060492478950819675,
        -0.039996598758678141,
        -0.082485268382030132,
        -0.0073176220958684905,
        0.083425573973154153,
        0.048948829840987432,
        -0.074276602295661617,
        -0.083869648318321743,
        0.070006074462888753,
        0.11877320998940447,
        -0.093544619297654251,
        -0.15696404875230866,
        0.20293370626522357,
        0.12779843730774364,
        -0.51100850016893237,
        0.60015865141838095,
        -0.40274110914791563,
        0.14869469357958934,
    ),
}
STIRLING = {
    torch.float32: (
        8.7539142e-5,
        -0.000300093659,
        0.000718752246,
        -0.00211799366,
        0.00774589727,
        -0.0249576499,
        0.0663257465,
    ),
    torch.float64: (
        7.8267105339420648e-7,
        -1.2882795690855538e-7,
        -1.6078101084121594e-6,
        -2.3106759371492112e-6,
        1.6294526957106985e-6,
        -9.908038704997819e-7,
        1.6938099372290475e-5,
        -2.7914843270793394e-5,
        7.8858067512822992e-5,
        -0.00028764709678220813,
        0.00072011795577257877,
        -0.0021195612054126181,
        0.0077458287803057503,
        -0.024957600667147584,
        0.066325747039872324,
    ),
}
ERFINV = {
    torch.float32: (
        5.20429811,
        -0.879408551,
        -6.18642479,
        2.38552132,
        5.00681198,
        -1.14708545,
        -1.69694039,
        1.86895015,
        1.69510528,
        0.156655107,
        1.41424231,
        2.99212469,
        2.00776721,
    ),
    torch.float64: (
        -5541.277672870309,
        -18801.892151421444,
        27110.023007457873,
        40996.864959667519,
        -44772.698892501954,
        -37113.648502578262,
        42721.499426720505,
        17546.825431742736,
        -27082.756952936845,
        -2742.9439240360347,
        12185.669324332039,
        -1978.9613771794048,
        -3662.4120635650926,
        1802.6159547056142,
        508.46706198157805,
        -732.67470122094931,
        219.60915384092512,
        174.06943796436105,
        -170.13463413635594,
        19.198401332585842,
        74.810399975243519,
        -24.871030769583035,
        -9.9237675635149394,
        18.480793664784104,
        2.2527294512426545,
        -0.72506689779083239,
        4.9641260630262076,
        2.3615593081323644,
        2.1776724061087441,
        4.3255286955885305,
        2.538561661906203,
    ),
}
# Tables: end.

# Midpoint of the map x -> q = c / (x + c) of each function, and of w -> w / (w + k) for erfinv; `top` is its last w.
ERFC_C = 2.5
STIRLING_C = 1.5
ERFINV_K = {torch.float32: 10.0, torch.float64: 12.0}
ERFINV_TOP = {torch.float32: 17.5, torch.float64: 37.5}

INV_SQRT_PI = 1 / math.sqrt(math.pi)


def constant(value: float, like: Tensor) -> float | Tensor:
    """`value`, in a form whose precision an ONNX export of float64 code keeps (Python scalars become float32 there)."""
    if like.dtype == torch.float64 and torch.compiler.is_exporting():
        return torch.tensor(value, dtype=like.dtype, device=like.device)
    return value


def polynomial(table: dict[torch.dtype, tuple[float, ...]], s: Tensor) -> Tensor:
    """Horner's scheme with the coefficients of `s`'s dtype, highest power first; s in [−½, ½]."""
    if s.dtype not in table:
        raise TypeError(
            f"torchms computes in float32 or float64; got {s.dtype}. Convert the inputs and parameters first."
        )
    first, second, *rest = (constant(c, s) for c in table[s.dtype])
    total = s * first + second
    for c in rest:
        total = total * s + c
    return total


def half_line(x: Tensor, c: float) -> tuple[Tensor, Tensor]:
    """q = c / (x + c), which is 1 at x = 0 and 0 at infinity, and s = ½ − q."""
    q = c / (x + c)
    return q, 0.5 - q


def erfcx_pair(x: Tensor) -> tuple[Tensor, Tensor]:
    """`erfcx(x)` and `ierfcx(x)` for x ≥ 0, which share a division."""
    q, s = half_line(x, ERFC_C)
    return q * polynomial(ERFCX, s), q * q * polynomial(IERFCX, s)


def erfcx(x: Tensor) -> Tensor:
    """e^{x²} erfc(x) for x ≥ 0; ~ 1 / (x √π) for large x."""
    q, s = half_line(x, ERFC_C)
    return q * polynomial(ERFCX, s)


def ierfcx(x: Tensor) -> Tensor:
    """e^{x²} ∫_x^∞ erfc = 1 / √π − x erfcx(x) for x ≥ 0; ~ 1 / (2 √π x²) for large x.

    Fitted directly, so its error is relative to itself: the difference loses all digits at large x.
    """
    q, s = half_line(x, ERFC_C)
    return q * q * polynomial(IERFCX, s)


def erfc(x: Tensor) -> Tensor:
    """1 − erf(x), accurate relative to itself for any x until it underflows."""
    tail = torch.exp(-x * x) * erfcx(x.abs())
    return torch.where(x < 0, 2 - tail, tail)


def erf(x: Tensor) -> Tensor:
    """(2 / √π) ∫_0^x e^{−t²} dt; its error is relative to 1."""
    tail = 1 - torch.exp(-x * x) * erfcx(x.abs())
    return torch.where(x < 0, -tail, tail)


def erfinv_of(y: Tensor, w: Tensor) -> Tensor:
    """erfinv(y), given w = −ln(1 − y²) ≥ 0 as well, which carries the precision near |y| = 1."""
    k, top = ERFINV_K[y.dtype], ERFINV_TOP[y.dtype]
    v = w / (w + k)
    return y * polynomial(ERFINV, v * constant((top + k) / top, v) - 0.5)


def erfinv(y: Tensor) -> Tensor:
    """x with erf(x) = y, for |y| < 1; finite (about 3.9 in float32, 5.9 in float64) at y = ±1."""
    tail = (1 - y.abs()).clamp_min(torch.finfo(y.dtype).eps / 4)
    return erfinv_of(y, -torch.log(tail * (1 + y.abs())).clamp_max(0))


def normal_quantile(u: Tensor) -> Tensor:
    """x with (1 + erf x) / 2 = u, for u in [0, 1): a variable of density e^{−x²} / √π.

    u = 0, which stands for all that a random-number generator rounds to it, is taken as eps / 4.
    """
    least = torch.finfo(u.dtype).eps / 4
    low, high = u.clamp_min(least), (1 - u).clamp_min(least)
    return erfinv_of(low - high, -torch.log(4 * low * high).clamp_max(0))


def stirling_difference(x: Tensor, d: Tensor) -> Tensor:
    """stirling(x + d) − stirling(x) for x, d ≥ 0, accurate relative to d where it is small.

    stirling(x) = ln Γ(1 + x) − [(x + ½) ln(1 + x) − (1 + x) + ½ ln 2π], which is ~ 1 / (12 x) for large x.
    """
    q0, s0 = half_line(x, STIRLING_C)
    q1, s1 = half_line(x + d, STIRLING_C)
    # stirling is q P(s) with s = ½ − q. Synthetic division gives P(s0) and Q(s1) = (P(s1) − P(s0)) / (s1 − s0), so that
    # q1 P(s1) − q0 P(s0) = (q1 − q0) (P(s0) − q1 Q(s1)), and q1 − q0 = −q0 q1 d / c.
    first, second, *rest = (constant(c, x) for c in STIRLING[x.dtype])
    quotient, at_s0 = first, s0 * first + second
    for c in rest:
        quotient = quotient * s1 + at_s0
        at_s0 = at_s0 * s0 + c
    return -q0 * q1 * (d / STIRLING_C) * (at_s0 - q1 * quotient)


def log_beta_step(a: Tensor, b: Tensor) -> Tensor:
    """ln[Γ(a + 1) Γ(b + 1) / Γ(a + b + 1)] for a, b ≥ 0: the logarithm of a B(a, 1 + b), at most 0.

    Symmetric in a and b. Finite, as is its gradient, at 0 and up to 1e8. Accurate relative to itself while one of the
    two is small; where both are, the relative error grows to a few roundings over the larger.
    """
    # With l the smaller, h the larger: ln Γ(1 + l) − [ln Γ(1 + h + l) − ln Γ(1 + h)], where Stirling's form
    # ln Γ(1 + x) = (x + ½) ln(1 + x) − x + stirling(x) + constant makes every term one of order l:
    # l [ln(1 + l) − ln(1 + h)] + ½ ln(1 + l) − (h + l + ½) ln(1 + l / (1 + h)) + the differences of `stirling`.
    less = a < b
    low, high = torch.where(less, a, b), torch.where(less, b, a)
    log_low = log1p(low)
    logs = low * (log_low - log1p(high)) + 0.5 * log_low - (high + low + 0.5) * log1p(low / (high + 1))
    value = logs + stirling_difference(torch.zeros_like(low), low) - stirling_difference(high, low)
    # Rounding may leave a positive value near 0, and so a negative probability; take it off, keep the gradient.
    return value - value.detach().clamp_min(0)
