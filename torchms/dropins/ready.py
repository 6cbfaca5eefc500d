"""Surfaces that are built in a call: numbers and tables where the maps are, machine code if it is wanted."""

from typing import TypeVar

import torch

from torchms.bsdfs import BSDF
from torchms.bsdfs.compile import compile as compiled_code
from torchms.parameters.exchange import weights, with_parameters

B = TypeVar("B", bound=BSDF)


def ready(surface: B, device: torch.device, compiled: bool) -> B:
    """`surface` with its tables on `device`, as machine code if `compiled`; the graphs of its maps stay."""
    elsewhere = {
        name: torch.empty_like(x, device=device).copy_(x) for name, x in weights(surface).items() if x.device != device
    }
    there = with_parameters(surface, elsewhere)
    return compiled_code(there, verbose=False) if compiled else there


def like_maps(number: float, maps: torch.Tensor) -> torch.Tensor:
    """`number` as a parameter beside `maps`."""
    return torch.full((), number, dtype=maps.dtype, device=maps.device)
