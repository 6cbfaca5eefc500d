"""Maps of parameters beside directions: shapes that broadcast to what nobody means."""

from collections.abc import Mapping
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from torchms.parameters.exchange import parameters, with_parameters

M = TypeVar("M", bound=nn.Module)


def fitted(module: M, *batches: torch.Size) -> M:
    """`module` beside tensors of these batch shapes: where they are (H, W), a map (H, W, 1) of a parameter without channels
    is the map (H, W); a shallow copy holds it. A map of as many axes as the batch broadcasts as it stands, also where all
    sizes are equal: (N, N, 1) beside (N, N, N) is one number for the last axis, as (N, 1) is beside N × L lights. A picture's
    map for every one of N lights is (H, W), or (1, H, W).

    Raises ValueError where two readings give different numbers: for such a map of one axis, (H, 1) beside (H), which is
    every value with every direction if it is taken at its word; and for (H, W) of a parameter with channels beside (H, W),
    which is W channels, not a gray map.
    """
    batch = batches[0]
    try:
        if any(other != batch for other in batches):
            batch = torch.broadcast_shapes(*batches)
    except RuntimeError:
        return module
    if not batch:
        return module
    maps: dict[str, Tensor] = {}
    for name, (record, value) in parameters(module).items():
        shape = value.shape
        if record.channels:
            if len(batch) > 1 and shape == batch and record.batch(value).numel() != 1:
                raise ValueError(
                    f"{name} of shape {tuple(shape)} beside a batch {tuple(batch)} is {shape[-1]} channels of a batch "
                    f"{tuple(shape[:-1])}: its last axis is that of the channels. Give a map of one channel as "
                    f"{name}[..., None], channels of every row as {name}[:, None], of every column as {name}[None]."
                )
        elif len(shape) == len(batch) + 1 and shape[-1] == 1 and shape[:-1] == batch and batch.numel() != 1:
            if len(batch) == 1:
                raise ValueError(
                    f"{name} of shape {tuple(shape)} beside a batch {tuple(batch)} would be every value with every direction, "
                    f"({batch[0]}, {batch[0]}). Give a value for each direction as {name}.squeeze(-1); if all pairs are "
                    "meant, give the directions as w[None]."
                )
            maps[name] = value.squeeze(-1)
    return with_parameters(module, maps)


def agreeing(name: str, coloured: Any, maps: Mapping[str, Any]) -> dict[str, Any]:
    """`maps` of numbers without channels beside the map `coloured` (*batch, C), called `name`; what is no tensor stays.

    A map (*batch, 1) is (*batch). Raises ValueError for a gray map (H, W) in place of (H, W, 1), and for maps that do not
    broadcast, or would give every value with every other.
    """
    batch = coloured.shape[:-1] if isinstance(coloured, Tensor) else torch.Size()
    found = dict(maps)
    for key, x in maps.items():
        if not isinstance(x, Tensor) or x.numel() == 1 or batch.numel() == 1:
            continue
        shapes = f"{name} of shape {tuple(coloured.shape)} beside {key} of shape {tuple(x.shape)}"
        if x.shape == coloured.shape:
            raise ValueError(
                f"{shapes}: the last axis of {name} is that of the channels, and {key} has none. Give a gray map as "
                f"{name}[..., None]; take one channel of {key}, {key}[..., 0]."
            )
        if x.shape == (*batch, 1):
            found[key] = x.squeeze(-1)
            continue
        try:
            whole = torch.broadcast_shapes(batch, x.shape)
        except RuntimeError:
            whole = None
        if whole is None or whole.numel() > max(batch.numel(), x.numel()):
            raise ValueError(
                f"{shapes}: the batches {tuple(batch)} and {tuple(x.shape)} are not those of one map. Give (H, W, C) beside "
                "(H, W) or (H, W, 1), or one number."
            )
    return found
