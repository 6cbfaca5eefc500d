"""Random numbers of the simulation: Philox4x32-10 [Salmon2011] of (key of the shard, ray, event), without a state.

So results depend neither on threads nor on batches. Numba's disk cache notices a change only in the file of the kernel that
is called: whoever edits this one, or another that kernels import, empties `__pycache__`.
"""

from typing import no_type_check

import numpy as np
from numba import njit

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
