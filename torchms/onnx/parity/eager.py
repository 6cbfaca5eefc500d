"""What eager says of a file's inputs, in any precision: the other side of the comparison."""

from typing import Any

import torch
from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.onnx.graph import Graph
from torchms.sampling.stream import Stream


def eagerly(graph: Graph, inputs: dict[str, Tensor], dtype: torch.dtype | None = None) -> Any:
    """What eager says, a tensor or a DirectionSample, for inputs as `grid` gives them, computed in `dtype`."""
    dtype = dtype or graph.bsdf.dtype
    values = {k: v.to(dtype) if v.is_floating_point() else v for k, v in inputs.items()}
    bsdf: BSDF = graph.substituted(values, dtype)
    wi = values["wi"]
    if graph.what == "pdf":
        return bsdf.pdf(wi, values["wo"])
    u = graph.numbers(values)
    if isinstance(u, Stream):
        # float32 numbers are what both get: 24 bits.
        u = u.uniforms(wi.shape[:1], bsdf.n_uniforms, dtype)
    elif u is not None:
        u = u.to(dtype)
    if graph.what == "sample":
        assert u is not None
        missing = bsdf.n_uniforms - u.shape[-1]
        u = torch.cat([u, u.new_zeros(*u.shape[:-1], missing)], -1)
        return bsdf.sample(wi, u.expand(*wi.shape[:1], *u.shape[-2:]))
    return getattr(bsdf, graph.what)(wi, values["wo"], u)


def density(bsdf: BSDF, wi: Tensor, wo: Tensor) -> Tensor:
    """`bsdf.pdf` of each path's direction, wo (rows, N, 3)."""
    return torch.stack([bsdf.pdf(wi, path) for path in wo.unbind(1)], 1)


def together(result: Any) -> Tensor:
    """One tensor (rows, …) of all outputs."""
    if isinstance(result, Tensor):
        return result
    return torch.cat([part if part.ndim == 3 else part[..., None] for part in result], -1)
