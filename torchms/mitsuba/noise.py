"""Random numbers for a value that is an estimate: Mitsuba gives none where it asks for one.

They follow from where the surface is met and from both directions, so that the same question has the same answer, which
integrators that ask twice (`prb`) rely on. Both times these are rounded differently, so they are put on a grid first: for
directions of 1/4096, for positions of 1/4096 of the largest coordinate, to the power of two below.
"""

from importlib import import_module
from typing import Any

Value = Any

GRID = 4096


def numbers(si: Any, wo: Any, count: int, seed: int) -> list[Value]:
    """`count` numbers in [0, 1) for light between si.wi and `wo` at si.p."""
    mi, dr = import_module("mitsuba"), import_module("drjit")
    size = dr.maximum(dr.maximum(dr.abs(si.p.x), dr.abs(si.p.y)), dr.maximum(dr.abs(si.p.z), mi.Float(1e-6)))
    cell = dr.detach(dr.exp2(dr.ceil(dr.log2(size)))) / GRID
    mixed = mi.UInt32(seed & 0xFFFFFFFF)
    places = [dr.detach(x) / cell for x in (si.p.x, si.p.y, si.p.z)]
    for x in (*places, *(dr.detach(c) * GRID for w in (si.wi, wo) for c in (w.x, w.y, w.z))):
        mixed, _ = mi.sample_tea_32(mixed, _whole(mi, dr.floor(x)))
    return [mi.sample_tea_float32(mixed, mi.UInt32(d + 1)) for d in range(count)]


def _whole(mi: Any, x: Value) -> Value:
    """A whole number as 32 bits."""
    return int(x) & 0xFFFFFFFF if isinstance(x, float) else mi.UInt32(mi.Int32(x))
