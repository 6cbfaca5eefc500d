"""What the drop-ins look at before they compute."""

import torch
from torch import Size, Tensor

from torchms.maths.frame import kind_of


def counts_all(owner: str, bounces: str | int) -> bool:
    """Whether all bounces are wanted, "all"; ValueError unless it is that or 1."""
    if bounces not in ("all", 1) or isinstance(bounces, bool):
        raise ValueError(f'{owner}(bounces=...) must be "all", or 1 for the formula that it replaces; got {bounces!r}.')
    return bounces == "all"


def check_map(owner: str, name: str, value: object, batch: Size, channels: int | None) -> None:
    """Raise TypeError or ValueError unless `value` is one number, or a map (*batch, channels); None: of any number."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return
    if not isinstance(value, Tensor) or not value.is_floating_point():
        raise TypeError(f"{owner}({name}=...) must be a number or a floating-point Tensor; got {kind_of(value)}.")
    constant = value.numel() == 1 or (channels is None and value.ndim == 1)
    if not constant and (value.shape[:-1] != batch or channels not in (None, value.shape[-1])):
        last = "C" if channels is None else str(channels)
        remedy = f" Give it as {name}[..., None]." if value.shape == batch else ""
        raise ValueError(
            f"{owner}({name}=...) must be (*batch, {last}) with the batch {tuple(batch)} of the points; got "
            f"{tuple(value.shape)}.{remedy}"
        )


def as_map(value: Tensor | float, like: Tensor) -> Tensor:
    """`value` with an axis at least, in the dtype and on the device of `like` if it is a number."""
    if not isinstance(value, Tensor):
        return torch.full((1,), float(value), dtype=like.dtype, device=like.device)
    return value.unsqueeze(-1) if value.ndim == 0 else value
