"""The error functions and the Beta function, in polynomials that vectorise and export.

No `erfinv`, `erfc`, `erfcx`, `lgamma`, `log1p` or `expm1` op: ONNX lacks them or has them with large relative errors.
float32 and float64 have polynomials of their own. Gradients are those of the polynomials.
"""

import math

import torch
from torch import Tensor

from torchms.numerics import log1p

# The tables below: `python -m torchms.generate_special`, mpmath 1.3.0, November 2026; highest power first.
# Tables: begin.
ERFCX = {
    torch.float32: (
        -2.80640517e-5,
        1.08028519e-5,
        0.000263716324,
        -0.000165569994,
        -0.00191894447,
        0.00335325275,
        0.0113426705,
        -0.068499795,
        0.18156581,
        -0.321860772,
        0.421612726,
    ),
    torch.float64: (
        1.8100251661179292e-9,
        2.5050658726993375e-9,
        -1.4297276763253708e-8,
        -2.94804494217866e-8,
        4.4859777528788815e-8,
        1.8142119762549139e-7,
        7.6528759046111169e-9,
        -7.870007654306522e-7,
        -9.3933544233904878e-7,
        2.702803939135038e-6,
        7.3004777451222568e-6,
        -7.8132786858903284e-6,
        -4.5042693600871802e-5,
        2.3323209572952229e-5,
        0.00028107762359897707,
        -0.00017568331795414734,
        -0.0019275142232051635,
        0.0033572177217308532,
        0.011344620053543768,
        -0.068500458098440927,
        0.18156564665922276,
        -0.32186073977565935,
        0.42161272812228722,
    ),
}
IERFCX = {
    torch.float32: (
        -1.54525574e-5,
        -5.13518052e-5,
        0.000115033786,
        0.000431868755,
        -0.000718963533,
        -0.00243654332,
        0.00633841016,
        0.00798373618,
        -0.0638756689,
        0.150039972,
        -0.201370568,
        0.148694689,
    ),
    torch.float64: (
        -1.3979448682559185e-9,
        1.6806776316683457e-9,
        1.5903959176771997e-8,
        -6.200804374681797e-9,
        -8.8335885312277069e-8,
        -3.8597514171164069e-8,
        3.0607737169500603e-7,
        4.6152098808913937e-7,
        -6.1029966367611909e-7,
        -2.5172506220101969e-6,
        -4.4663220799978579e-7,
        1.0183785885394794e-5,
        1.1950397910397322e-5,
        -3.6267872214678524e-5,
        -8.1903953435861077e-5,
        0.0001367306141853296,
        0.00046395785152111123,
        -0.00073081733826292384,
        -0.0024525632617548229,
        0.0063416783207882364,
        0.0079874023317339775,
        -0.063876062521116546,
        0.15003966285459524,
        -0.20137055457395781,
        0.14869469357958934,
    ),
}
STIRLING = {
    torch.float32: (
        1.36779909e-6,
        -9.37792686e-6,
        4.49220154e-5,
        -0.000264749207,
        0.00193647432,
        -0.0124788249,
        0.0663257465,
    ),
    torch.float64: (
        4.7770450036267485e-11,
        -1.572606895856389e-11,
        -3.9253176474906236e-10,
        -1.1282597349361383e-9,
        1.591262398154979e-9,
        -1.9351638095698865e-9,
        6.6164450673009667e-8,
        -2.1808471305307339e-7,
        1.2321573048878593e-6,
        -8.9889717744440041e-6,
        4.5007372235786173e-5,
        -0.00026494515067657726,
        0.0019364571950764376,
        -0.012478800333573792,
        0.066325747039872324,
    ),
}
ERFINV = {
    torch.float32: (
        0.00127058059,
        -0.000429398706,
        -0.00604143046,
        0.00465922133,
        0.0195578593,
        -0.00896160507,
        -0.0265146936,
        0.0584046922,
        0.10594408,
        0.0195818884,
        0.353560578,
        1.49606235,
        2.00776721,
    ),
    torch.float64: (
        -5.1607169889568435e-6,
        -3.5021253212208755e-5,
        0.0001009927057007621,
        0.0003054504466032052,
        -0.00066716520328077606,
        -0.0011060729176574427,
        0.0025463997976017299,
        0.002091744593589632,
        -0.0064570324308721649,
        -0.0013079375858478712,
        0.011621159862834968,
        -0.0037745692771518799,
        -0.013970993284473772,
        0.013752868306775011,
        0.0077585916440060127,
        -0.022359457434721353,
        0.013403879018611152,
        0.021248710689008917,
        -0.041536775912196274,
        0.0093742194006766806,
        0.073057031225823749,
        -0.048576231971841866,
        -0.038764717044980232,
        0.14438120050612581,
        0.035198897675666477,
        -0.022658340555963512,
        0.31025787893913797,
        0.29519491351654555,
        0.54441810152718603,
        2.1627643477942653,
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


def polynomial(table: dict[torch.dtype, tuple[float, ...]], t: Tensor) -> Tensor:
    """Horner's scheme with the coefficients of `t`'s dtype, highest power first."""
    first, second, *rest = (constant(c, t) for c in table[t.dtype])
    total = t * first + second
    for c in rest:
        total = total * t + c
    return total


def half_line(x: Tensor, c: float) -> tuple[Tensor, Tensor]:
    """q = c / (x + c), which is 1 at x = 0 and 0 at infinity, and t = 1 − 2 q."""
    q = c / (x + c)
    return q, 1 - 2 * q


def erfcx_pair(x: Tensor) -> tuple[Tensor, Tensor]:
    """`erfcx(x)` and `ierfcx(x)` for x ≥ 0, which share a division."""
    q, t = half_line(x, ERFC_C)
    return q * polynomial(ERFCX, t), q * q * polynomial(IERFCX, t)


def erfcx(x: Tensor) -> Tensor:
    """e^{x²} erfc(x) for x ≥ 0; ~ 1 / (x √π) for large x."""
    q, t = half_line(x, ERFC_C)
    return q * polynomial(ERFCX, t)


def ierfcx(x: Tensor) -> Tensor:
    """e^{x²} ∫_x^∞ erfc = 1 / √π − x erfcx(x) for x ≥ 0; ~ 1 / (2 √π x²) for large x.

    Fitted directly, so its error is relative to itself: the difference loses all digits at large x.
    """
    q, t = half_line(x, ERFC_C)
    return q * q * polynomial(IERFCX, t)


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
    return y * polynomial(ERFINV, v * constant(2 * (top + k) / top, v) - 1)


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


def stirling(x: Tensor) -> Tensor:
    """ln Γ(1 + x) − [(x + ½) ln(1 + x) − (1 + x) + ½ ln 2π] for x ≥ 0; ~ 1 / (12 x) for large x."""
    q, t = half_line(x, STIRLING_C)
    return q * polynomial(STIRLING, t)


def log_beta_step(a: Tensor, b: Tensor) -> Tensor:
    """ln[Γ(a + 1) Γ(b + 1) / Γ(a + b + 1)] for a, b ≥ 0: the logarithm of a B(a, 1 + b), at most 0.

    Symmetric in a and b. Finite, as is its gradient, at 0 and up to 1e8.
    """
    # Stirling for each Γ, with the logarithms paired so that nothing cancels for large a or b:
    # (a + ½) ln(a + 1) + (b + ½) ln(b + 1) − (a + b + ½) ln(a + b + 1)
    #   = −(a + ½) ln(1 + b / (a + 1)) − (b + ½) ln(1 + a / (b + 1)) + ½ ln(1 + a + b).
    total = a + b
    pairs = (a + 0.5) * log1p(b / (a + 1)) + (b + 0.5) * log1p(a / (b + 1)) - 0.5 * log1p(total)
    rest = stirling(a) + stirling(b) - stirling(total)
    return rest - pairs - constant(1 - 0.5 * math.log(2 * math.pi), a)
