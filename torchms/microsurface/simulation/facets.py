"""Numba kernels: what a facet does to the rays that sit on it. Import it lazily: Numba is an extra.

Positions are in the grid frame of `Grid` (cells along x and y), directions in the world frame. A ray that sits on a facet has
its number in `tri`, and `side` +1 above the surface, −1 below it.
Kernels carry `no_type_check`, since the type checker's import hook would wrap them before Numba sees them.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from torchms.microsurface.simulation.philox import philox, unit


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
