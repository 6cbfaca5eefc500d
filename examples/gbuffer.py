"""A G-buffer to play with: a bumpy plate in world space (y up), seen by a camera above it."""

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import normalize


class GBuffer(NamedTuple):
    """Per pixel, (rows, columns, 3) each, in world space: where it is, its normal, and the unit vector to the camera."""

    position: Tensor
    normal: Tensor
    view: Tensor


class Maps(NamedTuple):
    """Per pixel: base colour (rows, columns, 3), metallic and roughness (rows, columns)."""

    base_color: Tensor
    metallic: Tensor
    roughness: Tensor


def gbuffer(size: int) -> GBuffer:
    """Of size × size pixels; the plate is 2 × 2 wide, the camera 2.2 above it."""
    t = (torch.arange(size) + 0.5) * (2 / size) - 1
    x, z = t.expand(size, size), t[:, None].expand(size, size)
    a, b = 2.5 * math.pi * x, 2 * math.pi * z
    y = 0.06 * torch.sin(a) * torch.cos(b)
    slope_x = 0.06 * 2.5 * math.pi * torch.cos(a) * torch.cos(b)
    slope_z = -0.06 * 2 * math.pi * torch.sin(a) * torch.sin(b)
    position = torch.stack([x, y, z], -1)
    normal = normalize(torch.stack([-slope_x, torch.ones_like(x), -slope_z], -1), dim=-1)
    return GBuffer(position, normal, normalize(torch.tensor([0.3, 2.2, 0.5]) - position, dim=-1))


def true_maps(size: int) -> Maps:
    """A checkerboard of metal and paint, rougher from left to right."""
    t = (torch.arange(size) + 0.5) / size
    u, v = t.expand(size, size), t[:, None].expand(size, size)
    board = ((4 * u).floor() + (4 * v).floor()) % 2
    gold, paint = torch.tensor([0.95, 0.68, 0.32]), torch.stack([0.15 + 0.5 * v, 0.25 + 0.3 * u, 0.7 - 0.5 * v], -1)
    base = board[..., None] * gold + (1 - board[..., None]) * paint
    return Maps(base, board, 0.4 + 0.55 * u)


def side_by_side(pictures: list[list[Tensor]], gap: int = 2) -> Tensor:
    """Rows of pictures (rows, columns, 3) or maps (rows, columns) as one picture, small ones with larger pixels."""
    lines = []
    scale = max(1, 160 // len(pictures[0][0]))
    for line in pictures:
        tiles = [p if p.ndim == 3 else p[..., None].expand(*p.shape, 3) for p in line]
        tiles = [tile.repeat_interleave(scale, 0).repeat_interleave(scale, 1) for tile in tiles]
        framed = [torch.nn.functional.pad(tile, (0, 0, gap, gap, gap, gap), value=1.0) for tile in tiles]
        lines.append(torch.cat(framed, 1))
    return torch.cat(lines, 0)
