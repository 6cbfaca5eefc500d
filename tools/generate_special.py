"""Writes the coefficient tables of `torchms/maths/special.py`: python -m tools.generate_special (needs mpmath; 5 s).

Each function is divided by the power of q = c / (x + c) that makes it tend to a constant, mapped to t = 1 − 2 q in
[−1, 1] (x = 0 is t = −1, x = ∞ is t = 1), interpolated at Chebyshev nodes with 60 digits, truncated in the Chebyshev
basis and converted to powers of t / 2, highest first. The last table is of erfinv(y) / y over w = −ln(1 − y²).

Powers of t / 2, because their coefficients are larger: onnxscript's optimizer drops `+ c` for |c| < 1e-8.
"""

import pathlib
import re
from collections.abc import Callable
from typing import Any

import mpmath as mp

from torchms.maths import special
from torchms.storage.write import write_whole

Real = Any
"""An mp.mpf; mpmath has no types."""

mp.mp.dps = 60
NODES = 64
FAR = mp.mpf(10) ** 9
START, END = "# Tables: begin.", "# Tables: end."


def chebyshev(f: Callable[[Real], Real], degree: int) -> list[Real]:
    """Coefficients, in powers of t / 2 (highest first), of the degree-`degree` Chebyshev truncation of f on [−1, 1]."""
    angles = [mp.pi * (k + mp.mpf(1) / 2) / NODES for k in range(NODES)]
    values = [f(mp.cos(a)) for a in angles]
    series = [(2 - (j == 0)) * mp.fdot(values, [mp.cos(j * a) for a in angles]) / NODES for j in range(degree + 1)]
    # T_{j+1} = 2 t T_j − T_{j−1}, in powers of t, lowest first.
    previous, current = [mp.mpf(1)] + [mp.mpf(0)] * degree, [mp.mpf(0), mp.mpf(1)] + [mp.mpf(0)] * (degree - 1)
    powers = [series[0] * p + series[1] * c for p, c in zip(previous, current, strict=True)]
    for j in range(2, degree + 1):
        previous, current = current, [2 * s - p for s, p in zip([mp.mpf(0)] + current[:-1], previous, strict=True)]
        powers = [total + series[j] * c for total, c in zip(powers, current, strict=True)]
    return [c * 2**k for k, c in enumerate(powers)][::-1]


def erfcx(x: Real) -> Real:
    """e^{x²} erfc(x)."""
    if x < 60:
        with mp.workdps(80):
            return mp.exp(x * x) * mp.erfc(x)
    return (1 / x - 1 / (2 * x**3) + 3 / (4 * x**5)) / mp.sqrt(mp.pi) + remainder(x, 3) / x


def remainder(x: Real, first: int) -> Real:
    """Σ_{n ≥ first} (−1)^n (2n − 1)!! / (2 x²)^n / √π, the asymptotic series of x erfcx(x), down to 1e-60."""
    term, total = mp.mpf(1), mp.mpf(0)
    for n in range(1, 400):
        term *= -(2 * n - 1) / (2 * x * x)
        total += term if n >= first else 0
        if abs(term) < mp.mpf(10) ** -60:
            break
    return total / mp.sqrt(mp.pi)


def ierfcx(x: Real) -> Real:
    """1 / √π − x erfcx(x)."""
    return 1 / mp.sqrt(mp.pi) - x * erfcx(x) if x < 60 else -remainder(x, 1)


def stirling(x: Real) -> Real:
    """ln Γ(1 + x) − (x + ½) ln(1 + x) + (1 + x) − ½ ln 2π."""
    z = 1 + x
    return mp.loggamma(z) - (z - mp.mpf(1) / 2) * mp.log(z) + z - mp.log(2 * mp.pi) / 2 if z < 1e8 else 1 / (12 * z)


def erfinv_ratio(w: Real) -> Real:
    """erfinv(y) / y at y = √(1 − e^{−w})."""
    if w == 0:
        return mp.sqrt(mp.pi) / 2
    y = mp.sqrt(-mp.expm1(-w))
    tail = mp.exp(-w) / (1 + y)
    if w < 0.5:
        return mp.erfinv(y) / y
    x = mp.sqrt(w) * 0.95
    for _ in range(60):
        # Halley's step for ln erfc, well above rounding.
        step = (mp.erfc(x) - tail) * mp.sqrt(mp.pi) / 2 * mp.exp(x * x)
        x += step / (1 + x * step)
    return x / y


def on_half_line(f: Callable[[Real], Real], power: int, c: float) -> Callable[[Real], Real]:
    """t -> f(x) / q^power with q = c / (x + c) = (1 − t) / 2."""
    c = mp.mpf(c)

    def g(t: Real) -> Real:
        x = min(c * (1 + t) / (1 - t), FAR)
        return f(x) * ((x + c) / c) ** power

    return g


def on_interval(f: Callable[[Real], Real], k: float, top: float) -> Callable[[Real], Real]:
    """t -> f(w), where v = w / (w + k) runs linearly from 0 to top / (top + k)."""
    k, top = mp.mpf(k), mp.mpf(top)

    def g(t: Real) -> Real:
        v = top / (top + k) * (t + 1) / 2
        return f(k * v / (1 - v))

    return g


TABLES = {
    "ERFCX": ({"float32": 10, "float64": 22}, {d: on_half_line(erfcx, 1, 2.5) for d in ("float32", "float64")}),
    "IERFCX": ({"float32": 11, "float64": 24}, {d: on_half_line(ierfcx, 2, 2.5) for d in ("float32", "float64")}),
    "STIRLING": ({"float32": 6, "float64": 14}, {d: on_half_line(stirling, 1, 1.5) for d in ("float32", "float64")}),
    "ERFINV": (
        {"float32": 12, "float64": 30},
        {"float32": on_interval(erfinv_ratio, 10.0, 17.5), "float64": on_interval(erfinv_ratio, 12.0, 37.5)},
    ),
}


def tables() -> str:
    """The source text of all tables."""
    lines = [START]
    for name, (degrees, functions) in TABLES.items():
        lines.append(f"{name} = {{")
        for dtype, degree in degrees.items():
            lines.append(f"    torch.{dtype}: (")
            digits = 9 if dtype == "float32" else 17
            lines += [f"        {mp.nstr(c, digits)}," for c in chebyshev(functions[dtype], degree)]
            lines.append("    ),")
        lines.append("}")
    return "\n".join([*lines, END])


if __name__ == "__main__":
    target = pathlib.Path(special.__file__)
    source = target.read_text(encoding="utf-8")
    write_whole(target, re.sub(f"(?s){START}.*{END}", lambda _: tables(), source).encode(), force=True)
