"""The yardstick: a plain scalar height walk with next-event estimation [Heitz2016], compiled by Numba, a row a thread.

What a renderer's C++ does, written once more: one random walk a row, each collision connected to wo by the phase
function and the probability U^Λ(wo) of getting out, mirror facets with F = 1, isotropic GGX or Beckmann. It shares no
code with torchms; tests/crosscheck/test_yardstick.py checks it against the library.
"""

import math

import numpy as np
from numba import config, njit, prange

# Numba's OpenMP layer sets the number of threads of the whole process, torch's too.
config.THREADING_LAYER = "workqueue"  # pyright: ignore[reportAttributeAccessIssue]: made at run time

GGX, BECKMANN = 0, 1
_INVERSE = 1 / 4294967296


@njit(inline="always", error_model="numpy")
def _next(state):
    """PCG-XSH-RR [O'Neill 2014]: the new state and a number in (0, 1)."""
    state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    word = np.uint32(((state >> np.uint64(18)) ^ state) >> np.uint64(27))
    turn = np.uint32(state >> np.uint64(59))
    word = np.uint32((word >> turn) | (word << np.uint32((np.uint32(32) - turn) & np.uint32(31))))
    return state, (np.float64(word) + 0.5) * _INVERSE


@njit(inline="always", error_model="numpy")
def _seed(seed, row):
    """A well-mixed state for each row (splitmix64)."""
    z = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(row) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(inline="always", error_model="numpy")
def _lambda(z, alpha, kind):
    """Λ of a direction with cosine z, signed."""
    if z > 0.9999999:
        return 0.0
    if z < -0.9999999:
        return -1.0
    a = z / (alpha * math.sqrt(1 - z * z))
    if kind == 0:
        root = math.sqrt(1 + 1 / (a * a))
        return (root - 1) / 2 if a > 0 else (-root - 1) / 2
    return (math.erf(a) - 1) / 2 + math.exp(-a * a) / (2 * a * math.sqrt(math.pi))


@njit(inline="always", error_model="numpy")
def _density(z, alpha, kind):
    """D of a normal with cosine z."""
    if z <= 0:
        return 0.0
    c2 = z * z
    if kind == 0:
        q = c2 * (alpha * alpha - 1) + 1
        return alpha * alpha / (math.pi * q * q)
    return math.exp((c2 - 1) / (c2 * alpha * alpha)) / (math.pi * alpha * alpha * c2 * c2)


@njit(inline="always", error_model="numpy")
def _beckmann_slope(cos, sin, u):
    """Slope along the direction of view: the CDF [erf(x) cos + sin e^(−x²) / √π] is inverted by Newton and bisection."""
    # Slopes reach from −∞ to cot θ, beyond which facets face away.
    top = cos / max(sin, 1e-9)
    total = 0.5 * ((1 + math.erf(top)) * cos + sin * math.exp(-top * top) / math.sqrt(math.pi))
    high = min(top, 6.0)
    low = -6.0
    if high < low:
        return high
    x = min(max(0.0, low), high) if high > 0 else 0.5 * (low + high)
    for _ in range(40):
        e = math.exp(-x * x)
        value = 0.5 * ((1 + math.erf(x)) * cos + sin * e / math.sqrt(math.pi)) - u * total
        if value > 0:
            high = x
        else:
            low = x
        slope = (cos - x * sin) * e / math.sqrt(math.pi)
        step = x - value / slope if slope > 0 else low - 1.0
        new = step if low < step < high else 0.5 * (low + high)
        if abs(new - x) < 1e-7:
            return new
        x = new
    return x


@njit(inline="always", error_model="numpy")
def _normal(x, y, z, alpha, kind, u0, u1):
    """A visible normal from any direction (x, y, z)."""
    sx, sy = alpha * x, alpha * y
    r = 1 / math.sqrt(sx * sx + sy * sy + z * z)
    sx, sy, sz = sx * r, sy * r, z * r
    phi = 2 * math.pi * u0
    if kind == 0:
        cap = u1 * (1 + sz)
        sin = math.sqrt(max(cap * (2 - cap), 0.0))
        mx, my, mz = sin * math.cos(phi) + sx, sin * math.sin(phi) + sy, 1 - cap + sz
    else:
        sin = math.sqrt(sx * sx + sy * sy)
        along = _beckmann_slope(sz, sin, u1)
        # The slope across is a Gaussian of variance ½, by Box and Muller with a number that is left over of u0.
        v = u0 * 4096 - math.floor(u0 * 4096)
        across = math.sqrt(-math.log(max(v, 1e-12))) * math.cos(phi)
        c, s = (sx / sin, sy / sin) if sin > 1e-9 else (1.0, 0.0)
        # Normal (−p, −q, 1) with slopes p, q; `along` is measured against the direction of view.
        mx, my, mz = -(c * along - s * across), -(s * along + c * across), 1.0
    mx, my = alpha * mx, alpha * my
    r = 1 / math.sqrt(mx * mx + my * my + mz * mz)
    return mx * r, my * r, mz * r


@njit(inline="always", error_model="numpy")
def _collide(U, lam, up, u):
    """The U = C1(h) of the next collision along a ray with |Λ| = lam; above 1 if the ray escapes."""
    if up:
        return U * u ** (-1 / max(lam, 1e-12))
    return U * u ** (1 / max(lam, 1e-12))


@njit(parallel=True, error_model="numpy")
def evaluate(wi, wo, alpha, kind, K, seed):
    """f |cos θ_o| of each row (n, 3), (n, 3) → (n,), one walk a row."""
    n = wi.shape[0]
    out = np.empty(n, dtype=np.float32)
    for row in prange(n):
        state = _seed(seed, row)
        ox, oy, oz = float(wo[row, 0]), float(wo[row, 1]), float(wo[row, 2])
        lam_o = _lambda(oz, alpha, kind)
        dx, dy, dz = -float(wi[row, 0]), -float(wi[row, 1]), -float(wi[row, 2])
        U, total = 1.0, 0.0
        for k in range(K):
            signed = _lambda(dz, alpha, kind)
            state, u = _next(state)
            U = _collide(U, abs(signed), dz > 0, u)
            if U > 1:
                break
            x, y, z = -dx, -dy, -dz
            area = (1 + _lambda(z, alpha, kind)) * z
            hx, hy, hz = x + ox, y + oy, z + oz
            h = hz / math.sqrt(hx * hx + hy * hy + hz * hz)
            total += _density(h, alpha, kind) / (4 * area) * U**lam_o
            if k + 1 < K:
                state, u0 = _next(state)
                state, u1 = _next(state)
                mx, my, mz = _normal(x, y, z, alpha, kind, u0, u1)
                c = 2 * (x * mx + y * my + z * mz)
                dx, dy, dz = c * mx - x, c * my - y, c * mz - z
        out[row] = total
    return out


@njit(parallel=True, error_model="numpy")
def walk(wi, alpha, kind, K, seed):
    """Where the walk of each row leaves, (n, 3); zeros if it has not after K bounces."""
    n = wi.shape[0]
    out = np.zeros((n, 3), dtype=np.float32)
    for row in prange(n):
        state = _seed(seed, row)
        dx, dy, dz = -float(wi[row, 0]), -float(wi[row, 1]), -float(wi[row, 2])
        U = 1.0
        for k in range(K + 1):
            state, u = _next(state)
            U = _collide(U, abs(_lambda(dz, alpha, kind)), dz > 0, u)
            if U > 1:
                out[row, 0], out[row, 1], out[row, 2] = dx, dy, dz
                break
            if k == K:
                break
            state, u0 = _next(state)
            state, u1 = _next(state)
            x, y, z = -dx, -dy, -dz
            mx, my, mz = _normal(x, y, z, alpha, kind, u0, u1)
            c = 2 * (x * mx + y * my + z * mz)
            dx, dy, dz = c * mx - x, c * my - y, c * mz - z
    return out
