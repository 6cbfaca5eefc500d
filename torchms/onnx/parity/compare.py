"""An exported file against eager, element by element."""

import contextlib
import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchms.onnx.evaluator import Evaluator
from torchms.onnx.graph import Graph
from torchms.onnx.parity.bounds import Bounds, bounds_of
from torchms.onnx.parity.eager import density, eagerly, together
from torchms.onnx.parity.grid import grid
from torchms.sampling.uniforms import integers

ROWS = 1 << 18
BLACK = 1e-9
"""Values [1/sr] below this are black: an error relative to them is one relative to this."""
NUDGES = 128
"""How often an element that is off is evaluated again, with inputs moved by a few units in the last place."""


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


class Results(NamedTuple):
    """What the file and eager gave for the same inputs, (rows, …), and float64 for each of the two.

    Of a sample, `eager` has its own directions and its density at the file's; `eager_own` has its own of both. Otherwise
    they are the same. file_ns, eager_ns: time a row.
    """

    file: Tensor
    eager: Tensor
    eager_own: Tensor
    file_exact: Tensor
    eager_exact: Tensor
    file_ns: float
    eager_ns: float


def check(content: bytes, graph: Graph, rows: int = ROWS, seed: int = 0, bounds: Bounds | None = None) -> Parity:
    """Compare `content`, the file that `graph` gave, with eager."""
    bounds = bounds or bounds_of(graph)
    inputs = grid(graph, rows, seed)
    with torch.no_grad(), _one_thread():
        r = _evaluated(content, graph, inputs)
        difference = (r.file.double() - r.eager.double()).abs()
        relative = difference / _scale(graph, r.eager)
        above = ~(relative <= bounds.max)
        sensitive = above & ((r.eager.double() - r.file_exact).abs() >= difference / 2)
        which = (above & ~sensitive).reshape(rows, -1).any(1)
        if bool(which.any()):
            some = {name: value[which] for name, value in inputs.items()}
            sensitive[which] |= above[which] & _sensitive(graph, some, difference[which], r.eager[which])
    sides = ((r.file, r.file_exact), (r.eager_own, r.eager_exact))
    rms_file, rms_eager = (_rms(graph, value, exact) for value, exact in sides)
    steady = tuple(_rms(graph, torch.where(sensitive, exact, value.double()), exact) for value, exact in sides)
    measured = {
        "misses": int((above & ~sensitive).sum()),
        "rel_p999": _quantile(relative, 0.999),
        "sensitive": int(sensitive.sum()),
        "elements": relative.numel(),
    }
    return Parity(
        abs_max=float(torch.where(sensitive, 0.0, difference).max()),
        abs_p999=_quantile(difference, 0.999),
        rel_max=float(torch.where(sensitive, 0.0, relative).max()),
        own_p999=_quantile(difference / r.eager.double().abs().clamp_min(BLACK), 0.999),
        sensitive_max=float(torch.where(sensitive, relative, 0.0).max()),
        rms_file=rms_file,
        rms_eager=rms_eager,
        file_ns=r.file_ns,
        eager_ns=r.eager_ns,
        bounds=bounds,
        failures=tuple(_failures(bounds, **measured, rms_file=steady[0], rms_eager=steady[1])),
        **measured,
    )


def _evaluated(content: bytes, graph: Graph, inputs: dict[str, Tensor]) -> Results:
    """File and eager on `inputs`, and eager once more in float64."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checked.onnx"
        path.write_bytes(content)
        evaluator = Evaluator(path)
    start = time.perf_counter()
    result = evaluator(**inputs)
    middle = time.perf_counter()
    expected = eagerly(graph, inputs)
    end = time.perf_counter()
    double = eagerly(graph, inputs, torch.float64)
    ns = [seconds / len(inputs["wi"]) * 1e9 for seconds in (middle - start, end - middle)]
    if graph.what != "sample":
        return Results(result, expected, expected, double, double, *ns)
    # A density is compared at the direction that it belongs to.
    wi, wo = inputs["wi"], result.wo
    exact_inputs = {name: x.double() if x.is_floating_point() else x for name, x in inputs.items()}
    surface, exact = graph.substituted(inputs), graph.substituted(exact_inputs, torch.float64)
    return Results(
        together(result),
        together((expected.wo, density(surface, wi, wo))),
        together(expected),
        together((double.wo, density(exact, wi.double(), wo.double()))),
        together((double.wo, density(exact, wi.double(), expected.wo.double()))),
        *ns,
    )


def _failures(
    bounds: Bounds, *, misses: int, rel_p999: float, sensitive: int, elements: int, rms_file: float, rms_eager: float
) -> Iterator[str]:
    """Which bounds are missed; the RMS errors are those without the sensitive elements."""
    if misses:
        yield f"{misses} elements above {bounds.max:g} relative"
    if not rel_p999 <= bounds.p999:
        yield f"99.9th percentile {rel_p999:.1e} above {bounds.p999:g}"
    if math.isfinite(bounds.rms_ratio) and not rms_file <= bounds.rms_ratio * rms_eager:
        yield (
            f"RMS error {rms_file:.1e} without the sensitive, more than {bounds.rms_ratio:g} times eager's {rms_eager:.1e}"
        )
    if sensitive > max(bounds.sensitive * elements, 1):
        yield f"{sensitive} sensitive elements of {elements}, more than {bounds.sensitive:g}"


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Torch with as many threads as the evaluator."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


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
        value = together(eagerly(graph, nudged))
        low, high = torch.minimum(low, value), torch.maximum(high, value)
    return (high - low).double() >= difference / 2


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
