"""Numba kernels: the tally of rays that left, and of those that are still inside. Import it lazily: Numba is an extra."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from torchms.microsurface.rays.grid import ESCAPED

# Energies are summed as integers, so that a sum does not depend on its order: 2^30 steps of one path's energy.
UNIT = float(1 << 30)
N_COS = 64
N_PHI = 64
PLANES = 4


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def in_steps(energy):
    """Energy as a whole number of 1/UNIT."""
    return np.int64(energy * UNIT + 0.5)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def bin_of(dx, dy, dz):
    """Bin of a direction: cos θ from −1 up, φ from 0."""
    i = min(int((dz + 1) * (N_COS / 2)), N_COS - 1)
    phi = math.atan2(dy, dx)
    if phi < 0:
        phi += 2 * math.pi
    return i, min(int(phi * (N_PHI / (2 * math.pi))), N_PHI - 1)


@njit(nogil=True, cache=True, inline="always")
@no_type_check
def move(to, r, weighted, weight, x, y, z, d, tri, side, ray):
    """Put the state of ray `r` in the place `to`."""
    x[to] = x[r]
    y[to] = y[r]
    z[to] = z[r]
    d[to, 0] = d[r, 0]
    d[to, 1] = d[r, 1]
    d[to, 2] = d[r, 2]
    tri[to] = tri[r]
    side[to] = side[r]
    ray[to] = ray[r]
    if weighted:
        for c in range(weight.shape[1]):
            weight[to, c] = weight[r, c]


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
                move(keep, r, weighted, weight, x, y, z, d, tri, side, ray)
            keep += 1
            continue
        i = 0
        j = 0
        if t == ESCAPED and lobes.shape[0]:
            i, j = bin_of(d[r, 0], d[r, 1], d[r, 2])
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
def remaining(factor, weighted, weight, total, n):
    """Add the energy of the first n rays to `total` (C,)."""
    for r in range(n):
        for c in range(factor.shape[0]):
            total[c] += in_steps(factor[c] * weight[r, c] if weighted else factor[c])
