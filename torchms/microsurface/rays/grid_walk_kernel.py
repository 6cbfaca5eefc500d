"""Numba kernel of `GridTracer`: an exact float64 walk through the cells. Import it lazily: Numba is an extra.

The surface is a function of (x, y), so a ray above it stays above it until f = z_ray − z_surface changes sign inside
some facet. The walk visits the facets in order and asks each for that sign: it cannot slip through an edge, needs no
offset, and starts on its own facet without meeting it. Blocks of 64 × 64 and of 8 × 8 cells are skipped when the ray
passes over them.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from torchms.microsurface.rays.grid import ESCAPED, LEAKED

FINE = 3
COARSE = 6
# Rounding leaves |f| near 1e-12 cells; more means that a ray has come to the wrong side.
TOLERANCE = 1e-7
MAX_BLOCKS = 10_000_000


@njit(nogil=True, cache=True)
@no_type_check
def block_bounds(h, shift):
    """Highest and lowest point of each block of 2^shift × 2^shift cells, float64."""
    nx, ny = h.shape
    bx = (nx + (1 << shift) - 1) >> shift
    by = (ny + (1 << shift) - 1) >> shift
    top = np.full((bx, by), -np.inf)
    bottom = np.full((bx, by), np.inf)
    for i in range(nx):
        for j in range(ny):
            a, b = i >> shift, j >> shift
            for p in range(2):
                for q in range(2):
                    v = np.float64(h[(i + p) % nx, (j + q) % ny])
                    top[a, b] = max(top[a, b], v)
                    bottom[a, b] = min(bottom[a, b], v)
    return top, bottom


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def block_exit(shift, i, j, nx, ny, ox, oy, dx, dy, ix, iy):
    """Cells of the block around cell (i, j), from low to high, and the ray parameters of its walls ahead."""
    lo_i = (i >> shift) << shift
    lo_j = (j >> shift) << shift
    hi_i = min(lo_i + (1 << shift), nx)
    hi_j = min(lo_j + (1 << shift), ny)
    tx = ((hi_i if dx > 0 else lo_i) - ox) * ix if dx != 0 else np.inf
    ty = ((hi_j if dy > 0 else lo_j) - oy) * iy if dy != 0 else np.inf
    return lo_i, lo_j, hi_i, hi_j, tx, ty


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def facet_hit(upper, h00, h10, h01, h11, ox, oy, oz, dx, dy, dz, i, j, ta, tb):
    """Ray parameter where the ray comes through this half of cell (i, j) between ta and tb (inf: not), and f(ta)."""
    u = ox + ta * dx - i
    v = oy + ta * dy - j
    if upper:
        sx = h11 - h01
        sy = h11 - h10
        f = oz + ta * dz - (h11 - sx * (1 - u) - sy * (1 - v))
    else:
        sx = h10 - h00
        sy = h01 - h00
        f = oz + ta * dz - (h00 + sx * u + sy * v)
    g = dz - sx * dx - sy * dy
    if g < 0:
        th = ta - f / g
        if th <= tb:
            return max(th, ta), f
    return np.inf, f


@njit(nogil=True, cache=True)
@no_type_check
def walk(h, top, bottom, far_top, far_bottom, scale, x, y, z, d, tri, side, n):
    """Move the first n rays to the facet they meet, in place; `tri` becomes its number, ESCAPED or LEAKED.

    h (nx, ny) float32, bounds of the FINE and then of the COARSE blocks, `scale` (3,) turns world directions into the
    grid frame. Returns how many rays leaked.
    """
    nx, ny = h.shape
    zmax = -np.inf
    zmin = np.inf
    for a in range(top.shape[0]):
        for b in range(top.shape[1]):
            zmax = max(zmax, top[a, b])
            zmin = min(zmin, bottom[a, b])
    leaks = 0
    for r in range(n):
        s = side[r]
        dx, dy, dz = d[r, 0] * scale[0], d[r, 1] * scale[1], s * d[r, 2] * scale[2]
        ox, oy, oz = x[r], y[r], s * z[r]
        roof = zmax if s > 0 else -zmin
        floor = zmin if s > 0 else -zmax
        start = tri[r]
        if start >= 0:
            cell = start >> 1
            own = start & 1
            i = cell // ny
            j = cell - i * ny
        else:
            own = -1
            i = min(int(ox), nx - 1)
            j = min(int(oy), ny - 1)
        ix = 1 / dx if dx != 0 else 0.0
        iy = 1 / dy if dy != 0 else 0.0
        t0 = 0.0
        found = LEAKED
        for _ in range(MAX_BLOCKS):
            z0 = oz + t0 * dz
            if dz > 0 and z0 > roof:
                found = ESCAPED
                break
            if dz < 0 and z0 < floor - TOLERANCE:
                break
            over = far_top[i >> COARSE, j >> COARSE] if s > 0 else -far_bottom[i >> COARSE, j >> COARSE]
            passes = False
            if z0 > over:
                lo_i, lo_j, hi_i, hi_j, tbx, tby = block_exit(COARSE, i, j, nx, ny, ox, oy, dx, dy, ix, iy)
                tb = max(min(tbx, tby), t0)
                passes = oz + tb * dz > over
            if not passes:
                over = top[i >> FINE, j >> FINE] if s > 0 else -bottom[i >> FINE, j >> FINE]
                lo_i, lo_j, hi_i, hi_j, tbx, tby = block_exit(FINE, i, j, nx, ny, ox, oy, dx, dy, ix, iy)
                tb = max(min(tbx, tby), t0)
                passes = min(z0, oz + tb * dz) > over
            if passes:
                t0 = tb
                if tbx < tby:
                    i = hi_i if dx > 0 else lo_i - 1
                    j = min(max(math.floor(oy + tb * dy), lo_j), hi_j - 1)
                else:
                    j = hi_j if dy > 0 else lo_j - 1
                    i = min(max(math.floor(ox + tb * dx), lo_i), hi_i - 1)
                own = -1
            else:
                hit = -1
                while True:
                    tcx = ((i + 1 if dx > 0 else i) - ox) * ix if dx != 0 else np.inf
                    tcy = ((j + 1 if dy > 0 else j) - oy) * iy if dy != 0 else np.inf
                    t1 = max(min(tcx, tcy), t0)
                    ip = i + 1 if i + 1 < nx else 0
                    jp = j + 1 if j + 1 < ny else 0
                    h00, h10 = s * np.float64(h[i, j]), s * np.float64(h[ip, j])
                    h01, h11 = s * np.float64(h[i, jp]), s * np.float64(h[ip, jp])
                    low = min(oz + t0 * dz, oz + t1 * dz)
                    if low <= max(max(h00, h10), max(h01, h11)):
                        # Signed distance past the diagonal at both ends: which halves, in which order.
                        sa = ox + t0 * dx - i + oy + t0 * dy - j - 1
                        slope = dx + dy
                        sb = sa + (t1 - t0) * slope if slope != 0 else sa
                        first = own if own >= 0 else (1 if sa > 0 or (sa == 0 and slope > 0) else 0)
                        last = 1 if sb > 0 else 0
                        if slope == 0:
                            last = first
                        td = t1
                        if first != last:
                            td = min(max(t0 - sa / slope, t0), t1)
                        if own < 0:
                            th, f = facet_hit(first, h00, h10, h01, h11, ox, oy, oz, dx, dy, dz, i, j, t0, td)
                            if f < -TOLERANCE:
                                hit = -2
                                break
                            if th < np.inf:
                                hit = first
                                t0 = th
                                break
                        if first != last:
                            th, f = facet_hit(last, h00, h10, h01, h11, ox, oy, oz, dx, dy, dz, i, j, td, t1)
                            if f < -TOLERANCE:
                                hit = -2
                                break
                            if th < np.inf:
                                hit = last
                                t0 = th
                                break
                    t0 = t1
                    own = -1
                    if tcx < tcy:
                        i += 1 if dx > 0 else -1
                        if i < lo_i or i >= hi_i:
                            break
                    else:
                        j += 1 if dy > 0 else -1
                        if j < lo_j or j >= hi_j:
                            break
                if hit == -2:
                    break
                if hit >= 0:
                    found = 2 * (i * ny + j) + hit
                    u = min(max(ox + t0 * dx - i, 0.0), 1.0)
                    v = min(max(oy + t0 * dy - j, 0.0), 1.0)
                    x[r] = i + u
                    y[r] = j + v
                    if hit == 1:
                        z[r] = s * (h11 - (h11 - h01) * (1 - u) - (h11 - h10) * (1 - v))
                    else:
                        z[r] = s * (h00 + (h10 - h00) * u + (h01 - h00) * v)
                    break
            # Exact periodic wrap: the cell moves by whole periods, and so does the origin.
            if i >= nx:
                i = 0
                ox -= nx
            elif i < 0:
                i = nx - 1
                ox += nx
            if j >= ny:
                j = 0
                oy -= ny
            elif j < 0:
                j = ny - 1
                oy += ny
        tri[r] = found
        if found == LEAKED:
            leaks += 1
    return leaks
