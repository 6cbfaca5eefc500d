"""Numba kernel: where the rays of a shard start. Import it lazily: Numba is an extra."""

from typing import no_type_check

import numpy as np
from numba import njit

from torchms.microsurface.simulation.philox import philox, unit


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
