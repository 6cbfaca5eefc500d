"""Numba kernels around Embree's queries: where rays start, and what its triangle numbers mean. Import it lazily."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from torchms.microsurface.rays.grid import ESCAPED, LEAKED

MAX_TRIES = 4
# Periods a ray may cross; only an exactly horizontal one comes near.
MAX_WRAPS = 1_000_000


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def surface_height(h, x, y):
    """Height of the mesh at (x, y), any period."""
    nx, ny = h.shape
    fx = math.floor(x)
    fy = math.floor(y)
    u = x - fx
    v = y - fy
    i = int(fx) % nx
    j = int(fy) % ny
    ip = i + 1 if i + 1 < nx else 0
    jp = j + 1 if j + 1 < ny else 0
    h10 = np.float64(h[ip, j])
    h01 = np.float64(h[i, jp])
    if u + v < 1:
        h00 = np.float64(h[i, j])
        return h00 + (h10 - h00) * u + (h01 - h00) * v
    h11 = np.float64(h[ip, jp])
    return h11 + (h01 - h11) * (1 - u) + (h10 - h11) * (1 - v)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def put_start(h, x, y, side, offset, origin, q, cx, cy):
    """Start of a ray on the facet at (x, y): float32 x and y first, then the height there, plus the offset."""
    fx = np.float32(x - cx)
    fy = np.float32(y - cy)
    origin[q, 0] = fx
    origin[q, 1] = fy
    origin[q, 2] = np.float32(surface_height(h, np.float64(fx) + cx, np.float64(fy) + cy) + side * offset)


@njit(nogil=True, cache=True)
@no_type_check
def start(h, scale, offset, x, y, z, d, tri, side, pending, tries, travelled, origin, direction, n):
    """Fill Embree's rays for the first n paths."""
    nx, ny = h.shape
    cx, cy = nx // 2, ny // 2
    for r in range(n):
        pending[r] = r
        tries[r] = 0
        travelled[r] = 0
        gx, gy, gz = d[r, 0] * scale[0], d[r, 1] * scale[1], d[r, 2] * scale[2]
        c = 1 / math.sqrt(gx * gx + gy * gy + gz * gz)
        direction[r, 0] = gx * c
        direction[r, 1] = gy * c
        direction[r, 2] = gz * c
        if tri[r] >= 0:
            put_start(h, x[r], y[r], side[r], offset, origin, r, cx, cy)
        else:
            origin[r, 0] = x[r] - cx
            origin[r, 1] = y[r] - cy
            origin[r, 2] = z[r]


@njit(nogil=True, cache=True)
@no_type_check
def resolve(
    h, scale, offset, margin, top, bottom, x, y, z, d, tri, side, pending, tries, travelled, origin, direction, ids
):
    """Turn Embree's answers into hits, escapes and leaks; rays to cast again move to the front.

    Returns how many are left, how many of those had met their own facet or a facet from behind, and how many leaked.
    """
    nx, ny = h.shape
    cx, cy = nx // 2, ny // 2
    width = ny + 2 * margin
    left = 0
    repeats = 0
    leaked = 0
    for p in range(ids.shape[0]):
        r = pending[p]
        s = side[r]
        gx, gy, gz = d[r, 0] * scale[0], d[r, 1] * scale[1], d[r, 2] * scale[2]
        ox, oy, oz = np.float64(origin[p, 0]) + cx, np.float64(origin[p, 1]) + cy, np.float64(origin[p, 2])
        again = False
        if ids[p] >= 0:
            upper = ids[p] & 1
            cell = ids[p] >> 1
            pi = cell // width
            i = pi - margin
            j = cell - pi * width - margin
            wi = i % nx
            wj = j % ny
            number = 2 * (wi * ny + wj) + upper
            ip = wi + 1 if wi + 1 < nx else 0
            jp = wj + 1 if wj + 1 < ny else 0
            h10, h01 = np.float64(h[ip, wj]), np.float64(h[wi, jp])
            if upper:
                h0 = np.float64(h[ip, jp])
                sx, sy = h0 - h01, h0 - h10
                ex, ey = ox - i - 1, oy - j - 1
            else:
                h0 = np.float64(h[wi, wj])
                sx, sy = h10 - h0, h01 - h0
                ex, ey = ox - i, oy - j
            # Height above the plane of the facet, and its rate along the ray.
            f = oz - (h0 + sx * ex + sy * ey)
            g = gz - sx * gx - sy * gy
            near = travelled[p] == 0 and number == tri[r]
            if g * s < 0 and not near:
                t = max(-f / g, 0.0)
                # Rounding may put the point a little outside of its facet.
                u = min(max(ox + t * gx - i, 0.0), 1.0)
                v = min(max(oy + t * gy - j, 0.0), 1.0)
                x[r] = wi + u
                y[r] = wj + v
                z[r] = h0 + (sx * (u - 1) + sy * (v - 1) if upper else sx * u + sy * v)
                tri[r] = number
                continue
            again = True
        if again:
            repeats += 1
            if tries[p] >= MAX_TRIES:
                tri[r] = LEAKED
                leaked += 1
                continue
            # The same place, ten times farther off the surface each time, or for a ray on its way: a little farther on.
            if travelled[p] == 0 and tri[r] >= 0:
                put_start(h, x[r], y[r], s, offset * 10.0 ** (tries[p] + 1), origin, left, cx, cy)
            else:
                step = offset * 10.0 ** (tries[p] + 1)
                norm = math.sqrt(gx * gx + gy * gy + gz * gz)
                origin[left, 0] = ox - cx + step * gx / norm
                origin[left, 1] = oy - cy + step * gy / norm
                origin[left, 2] = oz + step * gz / norm + s * step
            tries[left] = tries[p] + 1
            travelled[left] = travelled[p]
        else:
            # Out of the scene: t of the first wall that the ray meets.
            tx = ((nx + margin if gx > 0 else -margin) - ox) / gx if gx != 0 else np.inf
            ty = ((ny + margin if gy > 0 else -margin) - oy) / gy if gy != 0 else np.inf
            t = min(tx, ty)
            end = oz + t * gz
            if gz * s > 0 and end * s > (top if s > 0 else -bottom):
                tri[r] = ESCAPED
                continue
            if t == np.inf or (gz * s < 0 and end * s < (bottom if s > 0 else -top)) or travelled[p] >= MAX_WRAPS:
                tri[r] = LEAKED
                leaked += 1
                continue
            t -= 0.5 / max(abs(gx), abs(gy))
            ex, ey = ox + t * gx, oy + t * gy
            if tx < ty:
                ex -= nx if gx > 0 else -nx
                ey -= ny * math.floor(ey / ny)
            else:
                ey -= ny if gy > 0 else -ny
                ex -= nx * math.floor(ex / nx)
            origin[left, 0] = ex - cx
            origin[left, 1] = ey - cy
            origin[left, 2] = oz + t * gz
            tries[left] = 0
            travelled[left] = travelled[p] + 1
        direction[left, 0] = direction[p, 0]
        direction[left, 1] = direction[p, 1]
        direction[left, 2] = direction[p, 2]
        pending[left] = r
        left += 1
    return left, repeats, leaked
