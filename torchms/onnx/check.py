"""An exported file against eager, element by element, over a grid that goes where numbers are hard."""

import contextlib
import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchms.bsdfs import RoughDielectric
from torchms.bsdfs.base import BSDF
from torchms.distributions import GGX
from torchms.onnx.evaluator import Evaluator
from torchms.onnx.graph import Graph
from torchms.parameters.constrain import UNBOUNDED
from torchms.parameters.declared import Parameter
from torchms.sampling.stream import Stream
from torchms.sampling.uniforms import draw, integers

ROWS = 1 << 18
BLACK = 1e-9
"""Values [1/sr] below this are black: an error relative to them is one relative to this."""
NUDGES = 128
"""How often an element that is off is evaluated again, with inputs moved by a few units in the last place."""


@dataclass(frozen=True)
class Bounds:
    """What a file must keep.

    max, p999: relative errors against eager in its dtype, of all elements and of 99.9 % of them. rms_ratio: its RMS
    error over eager's, against float64, both without the sensitive elements. sensitive: share of elements above `max` for
    which eager itself is no better determined.
    """

    max: float
    p999: float
    rms_ratio: float = 3.0
    sensitive: float = 1e-5


SINGLE = Bounds(max=5e-6, p999=5e-6)
STEEP = Bounds(max=5e-6, p999=5e-6, sensitive=1e-3)
"""One bounce where float32 itself is not that good: glass, whose half vector cancels, and Beckmann's exponential."""
SAMPLE = Bounds(max=1e-3, p999=1e-5, sensitive=1e-4)
"""A direction and its density: near a tiny alpha one ulp of the direction moves the density."""
MULTIPLE = Bounds(max=1e-3, p999=1e-5, sensitive=5e-5)
GLASS = Bounds(max=1e-3, p999=1e-5, sensitive=1e-4)
"""Several bounces through glass: more branches, and orders that are small differences."""
DOUBLE = Bounds(max=1e-12, p999=1e-12, rms_ratio=math.inf)


@dataclass(frozen=True)
class Parity:
    """The comparison. Relative errors are |file − eager| / max(|eager|, BLACK).

    The error of an order is relative to the sum over the orders; `own_p999` is a 99.9th percentile relative to itself.

    sensitive: elements above the bound for which eager is no better: it is as far from float64 itself, or moves as much
    when its inputs move by a few units in the last place. A branch (escape or stay, reflect or refract, in sight or
    not) flips on rounding there, or a difference cancels. They are left out of `rel_max`, `abs_max` and the judgement of
    the RMS error, most of which one flip in 30 000 rows would be, and of nothing else; sensitive_max is the largest
    relative error of theirs. misses: elements above the bound without that excuse.
    rms_file, rms_eager: root mean square of the relative errors, none counted as more than 1, against float64.
    """

    elements: int
    abs_max: float
    abs_p999: float
    rel_max: float
    rel_p999: float
    own_p999: float
    sensitive: int
    sensitive_max: float
    misses: int
    rms_file: float
    rms_eager: float
    file_ns: float
    eager_ns: float
    bounds: Bounds
    failures: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def bounds_of(graph: Graph) -> Bounds:
    """The bounds that hold for this file."""
    if graph.bsdf.dtype == torch.float64:
        return DOUBLE
    glass = isinstance(graph.bsdf, RoughDielectric)
    if graph.what == "sample":
        return SAMPLE
    if not graph.draws:
        return SINGLE if isinstance(graph.bsdf.distribution, GGX) and not glass else STEEP
    return GLASS if glass else MULTIPLE


def check(content: bytes, graph: Graph, rows: int = ROWS, seed: int = 0, bounds: Bounds | None = None) -> Parity:
    """Compare `content`, the file that `graph` gave, with eager."""
    bounds = bounds or bounds_of(graph)
    inputs = grid(graph, rows, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checked.onnx"
        path.write_bytes(content)
        evaluator = Evaluator(path)
    with torch.no_grad(), _one_thread():
        start = time.perf_counter()
        result = evaluator(**inputs)
        middle = time.perf_counter()
        expected = eagerly(graph, inputs)
        end = time.perf_counter()
        double = eagerly(graph, inputs, torch.float64)
        if graph.what == "sample":
            # A density is compared at the direction that it belongs to.
            wo, at = result.wo, {"bsdf": graph.substituted(inputs), "wi": inputs["wi"]}
            exact = _double(graph, inputs)
            file, eager = _together(result), _together((expected.wo, density(**at, wo=wo)))
            file_exact = _together((double.wo, density(**exact, wo=wo.double())))
            eager_exact = _together((double.wo, density(**exact, wo=expected.wo.double())))
        else:
            file, eager, file_exact, eager_exact = result, expected, double, double
        difference = (file.double() - eager.double()).abs()
        relative = difference / _scale(graph, eager)
        above = ~(relative <= bounds.max)
        sensitive = above & ((eager.double() - file_exact).abs() >= difference / 2)
        which = (above & ~sensitive).reshape(rows, -1).any(1)
        if bool(which.any()):
            some = {name: value[which] for name, value in inputs.items()}
            sensitive[which] |= above[which] & _sensitive(graph, some, difference[which], eager[which])
    ours = eager if graph.what != "sample" else _together(expected)
    count, misses = int(sensitive.sum()), int((above & ~sensitive).sum())
    within = torch.where(sensitive, 0.0, relative)
    measured = {
        "rel_max": float(within.max()),
        "rel_p999": _quantile(relative, 0.999),
        "own_p999": _quantile(difference / eager.double().abs().clamp_min(BLACK), 0.999),
        "rms_file": _rms(graph, file, file_exact),
        "rms_eager": _rms(graph, ours, eager_exact),
    }
    steady = tuple(
        _rms(graph, torch.where(sensitive, exact, values.double()), exact)
        for values, exact in ((file, file_exact), (ours, eager_exact))
    )
    failures = []
    if misses:
        failures.append(f"{misses} elements above {bounds.max:g} relative")
    if not measured["rel_p999"] <= bounds.p999:
        failures.append(f"99.9th percentile {measured['rel_p999']:.1e} above {bounds.p999:g}")
    if math.isfinite(bounds.rms_ratio) and not steady[0] <= bounds.rms_ratio * steady[1]:
        failures.append(
            f"RMS error {steady[0]:.1e} without the sensitive, more than {bounds.rms_ratio:g} times eager's {steady[1]:.1e}"
        )
    if count > max(bounds.sensitive * relative.numel(), 1):
        failures.append(f"{count} sensitive elements of {relative.numel()}, more than {bounds.sensitive:g}")
    return Parity(
        elements=relative.numel(),
        abs_max=float(torch.where(sensitive, 0.0, difference).max()),
        abs_p999=_quantile(difference, 0.999),
        sensitive=count,
        sensitive_max=float(torch.where(sensitive, relative, 0.0).max()),
        misses=misses,
        file_ns=(middle - start) / rows * 1e9,
        eager_ns=(end - middle) / rows * 1e9,
        bounds=bounds,
        failures=tuple(failures),
        **measured,
    )


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Torch with as many threads as the evaluator."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


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


def _directions(rows: int, uniform: Any) -> Tensor:
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


def _parameter(record: Parameter, rows: int, channels: int, uniform: Any) -> Tensor:
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


def _sensitive(graph: Graph, inputs: dict[str, Tensor], difference: Tensor, eager: Tensor) -> Tensor:
    """Whether eager's own value moves by half the difference or more when its inputs move by a few ulps."""
    generator = torch.Generator().manual_seed(1)
    ulp = torch.finfo(graph.bsdf.dtype).eps
    low = high = eager
    for _ in range(NUDGES):
        nudged = {}
        for name, value in inputs.items():
            if not value.is_floating_point() or name in {slot.name for slot in graph.slots}:
                nudged[name] = value
                continue
            step = integers(-8, 9, value.shape, generator) * ulp
            moved = value + step if name == "u" else value * (1 + step)
            nudged[name] = moved.clamp(0, 1 - ulp / 2) if name == "u" else moved.to(value.dtype)
        value = _together(eagerly(graph, nudged))
        low, high = torch.minimum(low, value), torch.maximum(high, value)
    return (high - low).double() >= difference / 2


def _together(result: Any) -> Tensor:
    """One tensor (rows, …) of all outputs."""
    if isinstance(result, Tensor):
        return result
    return torch.cat([part if part.ndim == 3 else part[..., None] for part in result], -1)


def _scale(graph: Graph, reference: Tensor) -> Tensor:
    """What a relative error is relative to: the value; for a direction its length, for an order all orders together."""
    scale = reference.double().abs()
    if graph.what == "orders":
        scale = scale.sum(1, keepdim=True).expand_as(scale)
    scale = scale.clamp_min(BLACK)
    if graph.what == "sample":
        scale[..., :3] = 1
    return scale


def _quantile(x: Tensor, q: float) -> float:
    x = x.flatten()
    return float(x.kthvalue(max(1, math.ceil(q * x.numel()))).values)


def _rms(graph: Graph, value: Tensor, exact: Tensor) -> float:
    relative = ((value.double() - exact).abs() / _scale(graph, exact)).clamp_max(1)
    return float(relative.square().mean().sqrt())


def _double(graph: Graph, inputs: dict[str, Tensor]) -> dict[str, Any]:
    values = {k: v.double() if v.is_floating_point() else v for k, v in inputs.items()}
    return {"bsdf": graph.substituted(values, torch.float64), "wi": values["wi"]}


def density(bsdf: BSDF, wi: Tensor, wo: Tensor) -> Tensor:
    """`bsdf.pdf` of each path's direction, wo (rows, N, 3)."""
    return torch.stack([bsdf.pdf(wi, path) for path in wo.unbind(1)], 1)
