"""Tables of constants inside kernels, on the device of what they are combined with."""

from collections.abc import Sequence

import torch
from torch import Tensor

_made: dict[tuple[tuple[float, ...], torch.dtype, torch.device], Tensor] = {}
MOST = 64
"""Tables that are remembered: kernels have a few, in two dtypes."""


def constants(values: Sequence[float], like: Tensor) -> Tensor:
    """`values` as (n,), of the dtype and on the device of `like`; made once, as every copy to a device waits for it.

    While a graph is traced they are made anew, and belong to the graph.
    """
    if torch.compiler.is_compiling():
        return torch.tensor(values, dtype=like.dtype, device=like.device)
    key = (tuple(values), like.dtype, like.device)
    found = _made.get(key)
    if found is None:
        # A tensor of an inference mode could never be used in a gradient.
        with torch.inference_mode(False):
            found = torch.tensor(values, dtype=like.dtype, device=like.device)
        # Only what holds numbers is kept: no fake one, nor that of another transform.
        if type(found) is Tensor:
            if len(_made) >= MOST:
                _made.clear()
            _made[key] = found
    return found
