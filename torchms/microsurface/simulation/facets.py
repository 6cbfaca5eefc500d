"""Numba kernels on batches of rays: launch, facet scattering, tally. Import it lazily: Numba is an extra.

Positions are in the grid frame of `grid.Grid` (cells along x and y), directions in the world frame. A ray that sits on
a facet has its number in `tri`, and `side` +1 above the surface, −1 below it. Every random number is Philox4x32-10
[Salmon2011] of (key of the shard, ray, event): no state, so results depend neither on threads nor on batches.
Kernels carry `no_type_check`, since the type checker's import hook would wrap them before Numba sees them. They
all live in one file, since Numba's disk cache notices a change only in the file of the kernel itself.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

ESCAPED = -1
LEAKED = -2
# Energies are summed as integers, so that a sum does not depend on its order: 2^30 steps of one path's energy.
UNIT = float(1 << 30)
N_COS = 64
N_PHI = 64
PLANES = 4

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint32(0x9E3779B9)
_W1 = np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_HIGH = np.uint64(32)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def philox(c0, c1, c2, c3, k0, k1):
    """Four 32-bit words of Philox4x32-10 at counter c, key k."""
    for _ in range(10):
        p0 = np.uint64(c0) * _M0
        p1 = np.uint64(c2) * _M1
        n0 = np.uint32((p1 >> _HIGH) & _LOW) ^ np.uint32(c1) ^ np.uint32(k0)
        n2 = np.uint32((p0 >> _HIGH) & _LOW) ^ np.uint32(c3) ^ np.uint32(k1)
        c1 = np.uint32(p1 & _LOW)
        c3 = np.uint32(p0 & _LOW)
        c0 = n0
        c2 = n2
        k0 = np.uint32(k0 + _W0)
        k1 = np.uint32(k1 + _W1)
    return c0, c1, c2, c3


@njit(nogil=True, cache=True)
@no_type_check
def philox_words(counter, key):
    """`philox` for tests: counter (4,), key (2,) uint32."""
    a, b, c, d = philox(counter[0], counter[1], counter[2], counter[3], key[0], key[1])
    return np.array([a, b, c, d], dtype=np.uint32)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def unit(word):
    """Uniform number in (0, 1) from 32 random bits."""
    return (np.float64(word) + 0.5) * (1.0 / 4294967296.0)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def even_bits(v):
    """The 32 bits of `v` at even places, packed."""
    v &= np.uint64(0x5555555555555555)
    v = (v | (v >> np.uint64(1))) & np.uint64(0x3333333333333333)
    v = (v | (v >> np.uint64(2))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    v = (v | (v >> np.uint64(4))) & np.uint64(0x00FF00FF00FF00FF)
    v = (v | (v >> np.uint64(8))) & np.uint64(0x0000FFFF0000FFFF)
    return (v | (v >> np.uint64(16))) & np.uint64(0x00000000FFFFFFFF)


@njit(nogil=True, cache=True)
@no_type_check
def launch(first, total, key, wi, nx, ny, top, x, y, z, d, tri, side, ray, n):
    """Rays `first` … `first + n − 1` of a shard of `total`, along −wi, over the tile at height `top`.

    Ray r starts at a random point of the r-th of `total` equal stretches of the Morton curve over the tile: uniform,
    stratified, and neighbours in number are neighbours in place, so no batch ever has to be sorted.
    """
    for r in range(n):
        number = first + r
        a, b, _, _ = philox(np.uint32(number), np.uint32(0), np.uint32(0), np.uint32(0), key[0], key[1])
        place = (np.float64(number) + unit(a)) / np.float64(total)
        # The double carries 53 bits of the curve; 11 more make the low bits of a small stretch as random as the high.
        code = (np.uint64(place * 9007199254740992.0) << np.uint64(11)) | np.uint64(b >> np.uint32(21))
        # As float32 about the middle of the tile, so that both tracers start at the very same point.
        u = (np.float64(even_bits(code >> np.uint64(1))) + 0.5) / 4294967296.0
        v = (np.float64(even_bits(code)) + 0.5) / 4294967296.0
        x[r] = np.float64(np.float32(u * nx - nx // 2)) + nx // 2
        y[r] = np.float64(np.float32(v * ny - ny // 2)) + ny // 2
        z[r] = np.float64(np.float32(top))
        d[r, 0] = -wi[0]
        d[r, 1] = -wi[1]
        d[r, 2] = -wi[2]
        tri[r] = -1
        side[r] = 1.0
        ray[r] = number


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def facet_slopes(h, t, kx, ky):
    """World slopes of facet t; kx, ky turn height steps per cell into slopes."""
    nx, ny = h.shape
    cell = t >> 1
    i = cell // ny
    j = cell - i * ny
    ip = i + 1 if i + 1 < nx else 0
    jp = j + 1 if j + 1 < ny else 0
    if t & 1:
        h11 = np.float64(h[ip, jp])
        return kx * (h11 - h[i, jp]), ky * (h11 - h[ip, j])
    h00 = np.float64(h[i, j])
    return kx * (h[ip, j] - h00), ky * (h[i, jp] - h00)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def vertex_slopes(h, i, j, kx, ky):
    """World slopes at a vertex, by central differences."""
    nx, ny = h.shape
    i = i % nx
    j = j % ny
    sx = 0.5 * kx * (np.float64(h[(i + 1) % nx, j]) - h[i - 1, j])
    sy = 0.5 * ky * (np.float64(h[i, (j + 1) % ny]) - h[i, j - 1])
    return sx, sy


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def smooth_slopes(h, t, x, y, kx, ky):
    """World slopes at (x, y) of facet t, interpolated between its three vertices."""
    ny = h.shape[1]
    cell = t >> 1
    i = cell // ny
    j = cell - i * ny
    u = min(max(x - i, 0.0), 1.0)
    v = min(max(y - j, 0.0), 1.0)
    ax, ay = vertex_slopes(h, i + 1, j, kx, ky)
    bx, by = vertex_slopes(h, i, j + 1, kx, ky)
    if t & 1:
        cx, cy = vertex_slopes(h, i + 1, j + 1, kx, ky)
        wa, wb, wc = 1 - v, 1 - u, u + v - 1
    else:
        cx, cy = vertex_slopes(h, i, j, kx, ky)
        wa, wb, wc = u, v, 1 - u - v
    return wa * ax + wb * bx + wc * cx, wa * ay + wb * by + wc * cy


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def normal(sx, sy, side):
    """Unit normal of the slopes, towards the side the light is on."""
    c = side / math.sqrt(1 + sx * sx + sy * sy)
    return -sx * c, -sy * c, c


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def shading_normal(h, t, x, y, kx, ky, side, smooth, dx, dy, dz):
    """Normal to scatter about; the facet's own where an interpolated one faces away from the light."""
    sx, sy = facet_slopes(h, t, kx, ky)
    gx, gy, gz = normal(sx, sy, side)
    if smooth:
        sx, sy = smooth_slopes(h, t, x, y, kx, ky)
        mx, my, mz = normal(sx, sy, side)
        if dx * mx + dy * my + dz * mz < 0:
            return mx, my, mz, gx, gy, gz
    return gx, gy, gz, gx, gy, gz


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def put_direction(d, r, dx, dy, dz, gx, gy, gz, side):
    """Store the unit direction; one on the wrong side of the facet (interpolated normals only) is mirrored back."""
    c = (dx * gx + dy * gy + dz * gz) * side
    if c < 0:
        c *= 2 * side
        dx -= c * gx
        dy -= c * gy
        dz -= c * gz
    scale = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
    d[r, 0] = dx * scale
    d[r, 1] = dy * scale
    d[r, 2] = dz * scale


@njit(nogil=True, cache=True)
@no_type_check
def scatter_mirror(h, kx, ky, smooth, x, y, d, tri, side, cosine, n):
    """Reflect every ray at its facet; `cosine` receives w · m."""
    for r in range(n):
        dx, dy, dz = d[r, 0], d[r, 1], d[r, 2]
        mx, my, mz, gx, gy, gz = shading_normal(h, tri[r], x[r], y[r], kx, ky, side[r], smooth, dx, dy, dz)
        c = -(dx * mx + dy * my + dz * mz)
        cosine[r] = min(max(c, 0.0), 1.0)
        put_direction(d, r, dx + 2 * c * mx, dy + 2 * c * my, dz + 2 * c * mz, gx, gy, gz, 1.0)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def dielectric_reflectance(c, eta):
    """Unpolarised Fresnel reflectance and cos θ_t for cos θ_i = c and η = n_t / n_i; total reflection: 1, 0."""
    cos2_t = 1 - (1 - c * c) / (eta * eta)
    if cos2_t <= 0:
        return 1.0, 0.0
    ct = math.sqrt(cos2_t)
    s = (c - eta * ct) / (c + eta * ct)
    p = (eta * c - ct) / (eta * c + ct)
    return 0.5 * (s * s + p * p), ct


@njit(nogil=True, cache=True)
@no_type_check
def scatter_dielectric(h, kx, ky, smooth, eta, event, key, x, y, d, tri, side, ray, n):
    """Reflect with probability F, else refract and change side."""
    for r in range(n):
        dx, dy, dz = d[r, 0], d[r, 1], d[r, 2]
        s = side[r]
        mx, my, mz, gx, gy, gz = shading_normal(h, tri[r], x[r], y[r], kx, ky, s, smooth, dx, dy, dz)
        c = min(max(-(dx * mx + dy * my + dz * mz), 0.0), 1.0)
        relative = eta if s > 0 else 1 / eta
        F, ct = dielectric_reflectance(c, relative)
        a, _, _, _ = philox(np.uint32(ray[r]), np.uint32(0), np.uint32(event), np.uint32(0), key[0], key[1])
        if unit(a) < F:
            put_direction(d, r, dx + 2 * c * mx, dy + 2 * c * my, dz + 2 * c * mz, gx, gy, gz, 1.0)
        else:
            # Snell: the tangential part shrinks by 1/η; c / η − cos θ_t goes along the normal.
            g = c / relative - ct
            put_direction(
                d, r, dx / relative + g * mx, dy / relative + g * my, dz / relative + g * mz, gx, gy, gz, -1.0
            )
            side[r] = -s


@njit(nogil=True, cache=True)
@no_type_check
def scatter_lambertian(h, kx, ky, smooth, event, key, x, y, d, tri, side, ray, n):
    """Cosine-distributed directions about the normal."""
    for r in range(n):
        mx, my, mz, gx, gy, gz = shading_normal(
            h, tri[r], x[r], y[r], kx, ky, side[r], smooth, d[r, 0], d[r, 1], d[r, 2]
        )
        a, b, _, _ = philox(np.uint32(ray[r]), np.uint32(0), np.uint32(event), np.uint32(0), key[0], key[1])
        # A point on the unit sphere around the tip of the normal is cosine-distributed about it.
        cz = 1 - 2 * unit(a)
        sz = math.sqrt(max(0.0, 1 - cz * cz))
        phi = 2 * math.pi * unit(b)
        dx, dy, dz = mx + sz * math.cos(phi), my + sz * math.sin(phi), mz + cz
        if dx * dx + dy * dy + dz * dz < 1e-20:
            dx, dy, dz = mx, my, mz
        put_direction(d, r, dx, dy, dz, gx, gy, gz, 1.0)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def in_steps(energy):
    """Energy as a whole number of 1/UNIT."""
    return np.int64(energy * UNIT + 0.5)


@njit(nogil=True, cache=True)
@no_type_check
def settle(order, factor, weighted, weight, reflected, transmitted, leaked, lobes, x, y, z, d, tri, side, ray, n):
    """Tally the rays that left after `order` events or leaked, close the gaps, and return how many go on.

    factor (C,) multiplies every ray's energy; `weight` (n, C) too if `weighted`. Tallies are int64 in steps of 1/UNIT:
    reflected, transmitted (K, C), leaked (C,), lobes (PLANES, N_COS, N_PHI, C), or (0, …) if nobody asked for them.
    """
    channels = factor.shape[0]
    plane = order - 1 if order < PLANES else -1
    keep = 0
    for r in range(n):
        t = tri[r]
        if t >= 0:
            if keep != r:
                x[keep] = x[r]
                y[keep] = y[r]
                z[keep] = z[r]
                d[keep, 0] = d[r, 0]
                d[keep, 1] = d[r, 1]
                d[keep, 2] = d[r, 2]
                tri[keep] = t
                side[keep] = side[r]
                ray[keep] = ray[r]
                if weighted:
                    for c in range(channels):
                        weight[keep, c] = weight[r, c]
            keep += 1
            continue
        i = 0
        j = 0
        if t == ESCAPED and lobes.shape[0]:
            i = min(int((d[r, 2] + 1) * (N_COS / 2)), N_COS - 1)
            phi = math.atan2(d[r, 1], d[r, 0])
            if phi < 0:
                phi += 2 * math.pi
            j = min(int(phi * (N_PHI / (2 * math.pi))), N_PHI - 1)
        for c in range(channels):
            energy = in_steps(factor[c] * weight[r, c] if weighted else factor[c])
            if t != ESCAPED or order == 0:
                leaked[c] += energy
                continue
            if side[r] > 0:
                reflected[order - 1, c] += energy
            else:
                transmitted[order - 1, c] += energy
            if lobes.shape[0]:
                lobes[PLANES - 1, i, j, c] += energy
                if plane >= 0:
                    lobes[plane, i, j, c] += energy
    return keep


@njit(nogil=True, cache=True)
@no_type_check
def remaining(factor, weighted, weight, rest, n):
    """Add the energy of the first n rays to `rest` (C,)."""
    for r in range(n):
        for c in range(factor.shape[0]):
            rest[c] += in_steps(factor[c] * weight[r, c] if weighted else factor[c])
