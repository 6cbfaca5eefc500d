"""Inputs of a file where numbers are hard: the grid that it is compared with eager over."""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from torchms.onnx.graph import Graph
from torchms.parameters.constrain import UNBOUNDED
from torchms.parameters.declared import Parameter
from torchms.sampling.uniforms import draw, integers

Uniform = Callable[..., Tensor]
"""Numbers in [0, 1) of a given shape."""


def grid(graph: Graph, rows: int, seed: int = 0) -> dict[str, Tensor]:
    """Inputs: poles, horizon, below it, near both, mirror directions; small and large parameters."""
    generator = torch.Generator().manual_seed(seed)
    dtype = graph.bsdf.dtype

    def uniform(*shape: int) -> Tensor:
        return draw(shape, 1, 1, generator=generator, dtype=torch.float64)[..., 0, 0]

    values = {slot.name: _parameter(slot.record, rows, graph.bsdf.n_channels, uniform) for slot in graph.slots}
    if "alpha" in values and "alpha_y" in values:
        # Anisotropy up to 10 : 1.
        ratio = 10 ** (2 * uniform(rows) - 1)
        values["alpha_y"] = (values["alpha"] * ratio).clamp(1e-3, 2.0)
    wi, wo = _directions(rows, uniform), _directions(rows, uniform)
    # A third of the rows near the mirror direction, where a smooth surface has its lobe.
    alpha = values.get("alpha", torch.full((rows,), 0.3, dtype=torch.float64))[:, None]
    mirror = wi * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64) + alpha * (2 * uniform(rows, 3) - 1)
    wo = torch.where((uniform(rows) < 1 / 3)[:, None], torch.nn.functional.normalize(mirror, dim=-1), wo)
    values |= {"wi": wi, "wo": wo}
    if "u" in graph.input_names:
        u = (uniform(rows, graph.n_paths or 2, graph.n_uniforms) * (1 << 24)).floor() / (1 << 24)
        edge = uniform(*u.shape)
        values["u"] = torch.where(edge < 1e-3, 0.0, torch.where(edge > 1 - 1e-3, 1 - 2.0**-24, u))
    if "seed" in graph.input_names:
        values["seed"] = integers(-(2**63), 2**63 - 1, (rows,), generator)
    # What float32 can hold, for any dtype, so that all dtypes see the same numbers.
    return {
        name: v if v.dtype == torch.int64 else v.float().to(dtype)
        for name, v in values.items()
        if name in graph.input_names
    }


def _directions(rows: int, uniform: Uniform) -> Tensor:
    """A third each: uniform on the sphere, in the upper hemisphere, and special (poles, horizon, and near them)."""
    kind, sign = (uniform(rows) * 12).floor(), torch.where(uniform(rows) < 0.5, -1.0, 1.0)
    small = 10 ** (-1 - 6 * uniform(rows))
    z = 2 * uniform(rows) - 1
    z = torch.where((kind >= 4) & (kind < 8), z.abs(), z)
    z = torch.where(kind == 8, sign, z)
    z = torch.where(kind == 9, 0.0, z)
    z = torch.where(kind == 10, sign * small, z)
    z = torch.where(kind == 11, sign * (1 - small), z)
    r, phi = (1 - z * z).clamp_min(0).sqrt(), 2 * math.pi * uniform(rows)
    return torch.stack([r * phi.cos(), r * phi.sin(), z], -1)


def _parameter(record: Parameter, rows: int, channels: int, uniform: Uniform) -> Tensor:
    """Values over the whole declared range; indices of refraction, which have no end, where materials have them."""
    shape = (rows, channels) if record.channels else (rows,)
    x = uniform(*shape)
    low, high = record.low, record.high
    if high >= UNBOUNDED:
        if low > 0:
            # The index of a dielectric, on either side of 1.
            return torch.where(x < 0.5, 1.1 + x, 0.4 + x / 2)
        return 0.1 + (3 if record.open_low else 6) * x
    if low > 0:
        edge = (uniform(*shape) * 8).floor()
        return torch.where(edge == 0, low, torch.where(edge == 1, high, low * (high / low) ** x))
    return high - (high - low) * x if record.open_low else low + (high - low) * x
