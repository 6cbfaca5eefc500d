"""What an engine runs: a function of one BSDF, of directions as components, and of random numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor


@dataclass(frozen=True)
class Kernel:
    """A named function (bsdf, *directions, numbers) of (1, *rows) components and D numbers (N, *rows).

    It returns tensors (*lead, *rows), means over the N paths, or (*lead, N, *rows) if it is `per_path`.
    draws: whether it takes random numbers from this BSDF's callers.
    """

    name: str
    function: Callable[..., tuple[Tensor, ...]]
    per_path: bool = False
    draws: Callable[[Any], bool] = lambda bsdf: True

    def __call__(self, bsdf: Any, *inputs: Sequence[Tensor]) -> tuple[Tensor, ...]:
        return self.function(bsdf, *inputs)
