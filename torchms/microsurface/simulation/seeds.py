"""Seeds of the simulation: one stream a surface, one a shard, none shared.

The numbers themselves are Philox of (key, ray, event), see `facets.philox`: a ray's path does not depend on which
worker, thread or batch it runs in.
"""

import numpy as np

_SURFACE, _SHARD = 0, 1


def surface_seed(seed: int, surface: int) -> int:
    """Seed of the `surface`-th independent surface of a simulation."""
    words = np.random.SeedSequence(seed, spawn_key=(_SURFACE, surface)).generate_state(2, np.uint32)
    return int(words[0]) | int(words[1]) << 32


def shard_key(seed: int, surface: int, shard: int) -> np.ndarray:
    """(2,) uint32 Philox key of one shard."""
    return np.random.SeedSequence(seed, spawn_key=(_SHARD, surface, shard)).generate_state(2, np.uint32)
