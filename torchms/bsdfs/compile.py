"""`torchms.compile`: the same BSDF, its kernels fused into machine code by Inductor.

A kernel is traced once, over a block of a fixed number of elements (row × path), with its parameters as inputs, and is
then called block by block; the last block is padded. So no batch size is ever compiled anew, and shapes are constants to
Inductor, which it turns into one loop without intermediates in memory.
"""

import copy
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeVar

import torch
from rich.console import Console
from torch import Tensor
from torch._functorch.compile_utils import fx_graph_cse
from torch.fx.experimental.proxy_tensor import make_fx

from torchms.bsdfs.base import BSDF
from torchms.maths.frame import Vec3
from torchms.parameters.declared import structure
from torchms.parameters.exchange import parameters, with_parameters
from torchms.sampling.stream import StreamNumbers

B = TypeVar("B", bound=BSDF)

BLOCK = 65536
"""Elements of a block of several bounces, long against a call's overhead of 0.1 ms."""
BLOCK_SINGLE = 131072
"""Elements of a block of one bounce."""

# Inductor recomputes an intermediate in every kernel that reads it until it counts this many operations, then gives it
# a name. Bounces read each other's results so often that its default (30) multiplies the work of the compiler by twenty;
# named results inside one loop cost nothing. The loop must then not be cut at 64 names.
OPTIONS = {"realize_opcount_threshold": 6, "max_fusion_size": 1_000_000, "cpp.dynamic_threads": True}

SPLIT_CHANNELS = 8
"""Up to so many channels are computed one by one; more stay an axis, for the compiler's sake."""
CHANNEL_AXES: dict[str, tuple[int | None, ...]] = {
    "_forward": (-2,),
    "_orders": (-2,),
    "_albedo": (-2, -2),
    "_walk": (None, -3, None),
}
"""Kernel → the axis of the channels in each of its results."""

_console = Console(stderr=True)


def compile(bsdf: B, *, verbose: bool = True) -> B:
    """`bsdf` with its evaluations compiled by Inductor; it shares the parameters, and every method keeps its signature.

    The first call of each method compiles it (seconds to minutes, shown on stderr if `verbose`); results are cached on
    disk between processes in TORCHINDUCTOR_CACHE_DIR. Any batch shape, number of paths and per-pixel parameter runs
    through the same machine code, `backward` included, and so does another BSDF of the same classes: one may be built and
    compiled anew in every step of a training, around what a network gave. Directions are read fastest where components
    are contiguous: give `wi3.T` of a (3, n) tensor. Where no C++ compiler works, or the parameters are not on the CPU,
    warns once and gives back a BSDF that runs eagerly in blocks.
    Raises TypeError if `bsdf` is not a BSDF.
    """
    if not isinstance(bsdf, BSDF):
        raise TypeError(f"compile(bsdf) takes a BSDF such as RoughConductor(...); got {type(bsdf).__name__}.")
    fast = copy.copy(bsdf)
    missing = _missing_compiler()
    if missing:
        warnings.warn(
            f"torchms.compile: no working C++ compiler ({missing}); the BSDF runs eagerly, in blocks. "
            "Install g++ or clang++, or name one in the variable CXX.",
            RuntimeWarning,
            stacklevel=2,
        )
        return fast
    fast.engine = Engine(verbose)
    return fast


@cache
def _missing_compiler() -> str:
    """Why Inductor has no C++ compiler; empty if it has."""
    try:
        from torch._inductor.cpp_builder import get_cpp_compiler

        get_cpp_compiler()
    except Exception as error:
        return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return ""


MOST_PROGRAMS = 256

Program = tuple[Callable[..., tuple[Tensor, ...]], list[Any]]
"""A compiled kernel, and what its key knows by identity, which lives as long as the key is compared."""

_programs: dict[tuple[Any, ...], Program] = {}
"""Those of this process, for all BSDFs of the same structure."""


class Engine:
    """Runs the kernels of a BSDF as compiled code, a padded block at a time."""

    def __init__(self, verbose: bool) -> None:
        self.verbose = verbose
        self.compiled: dict[tuple[Any, ...], Program] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Engine":
        return Engine(self.verbose)

    def __reduce__(self) -> tuple[Any, ...]:
        return Engine, (self.verbose,)

    def block(self, bsdf: BSDF) -> int:
        """Elements of a block."""
        return BLOCK if bsdf.max_order > 1 else BLOCK_SINGLE

    def identify(self, bsdf: BSDF) -> tuple[tuple[Any, ...], list[Any]]:
        """What tells the code of `bsdf` from that of others, and the objects in it that are known by identity."""
        held: list[Any] = []
        return structure(bsdf, held, without=("engine",)), held

    def __call__(
        self,
        kernel: Callable[..., tuple[Tensor, ...]],
        bsdf: BSDF,
        directions: Sequence[Vec3],
        numbers: Sequence[Tensor],
        shape: tuple[int, int],
        per_path: bool,
        identity: tuple[tuple[Any, ...], list[Any]],
    ) -> tuple[Tensor, ...]:
        """What `kernel(bsdf, *directions, numbers)` gives for (N, rows) = `shape` elements, mean over N or per path.

        identity: what `identify` gave for the BSDF.
        """
        columns = _Columns(shape, self.block(bsdf))
        inputs = [columns.of(component) for w in directions for component in w]
        inputs += columns.numbers(numbers)
        layout: list[tuple[bool, bool]] = []
        for record, p in parameters(bsdf).values():
            mapped = p.ndim > record.channels
            layout.append((mapped, record.channels))
            inputs.append(columns.parameter(p, record.channels) if mapped else p)
        grad = tuple(torch.is_grad_enabled() and x.requires_grad for x in inputs)
        source = (type(numbers), bsdf.n_uniforms, bsdf.dtype, getattr(numbers, "points", None) is not None)
        shapes = tuple((x.dtype, x.shape) for x in inputs)
        key = (kernel, identity[0], tuple(layout), shapes, source, grad)
        if key not in self.compiled:
            if key not in _programs:
                given = (len(directions), source, tuple(layout))
                while len(_programs) >= MOST_PROGRAMS:
                    del _programs[next(iter(_programs))]
                _programs[key] = self._compile(kernel, bsdf, inputs, given), identity[1]
            self.compiled[key] = _programs[key]
        function, _ = self.compiled[key]
        return tuple(columns.back(out, per_path) for out in function(*inputs))

    def _compile(
        self, kernel: Callable[..., tuple[Tensor, ...]], bsdf: BSDF, inputs: list[Tensor], given: Any
    ) -> Callable[..., tuple[Tensor, ...]]:
        """Trace `kernel` as a function of its tensors, and hand it to Inductor."""
        n_directions, (kind, n_uniforms, dtype, has_points), layout = given
        size = inputs[0].shape[0]
        names = list(parameters(bsdf))

        channels = bsdf.n_channels
        split = CHANNEL_AXES.get(kernel.__name__, ()) if 1 < channels <= SPLIT_CHANNELS else ()

        def flat(*tensors: Tensor) -> tuple[Tensor, ...]:
            rest = iter(tensors)
            directions = [Vec3(*(next(rest)[None] for _ in range(3))) for _ in range(n_directions)]
            numbers: Sequence[Tensor] = ()
            if kind is StreamNumbers:
                seeds, paths = next(rest), next(rest)[None]
                points = next(rest)[:, None] if has_points else None
                numbers = StreamNumbers(seeds, paths, n_uniforms, dtype, points)
            elif n_uniforms_given:
                numbers = next(rest)[:, None].unbind(0)
            values = [
                p.T if mapped and has_channels else p for p, (mapped, has_channels) in zip(rest, layout, strict=True)
            ]

            def outputs(channel: int | None) -> tuple[Tensor, ...]:
                taken = {
                    name: p if channel is None or not has_channels or p.shape[-1] == 1 else p[..., channel, None]
                    for name, p, (_, has_channels) in zip(names, values, layout, strict=True)
                }
                return kernel(with_parameters(bsdf, taken), *directions, numbers)

            # Inductor fuses loops of one shape only: with the channels as an axis, every number that all of them share
            # would go through memory. Channel by channel they are one loop, and what is shared is computed once.
            if split:
                each = [outputs(channel) for channel in range(channels)]
                found = [
                    parts[0] if axis is None else torch.cat(parts, axis)
                    for axis, *parts in zip(split, *each, strict=True)
                ]
            else:
                found = outputs(None)
            return tuple(out.expand(*out.shape[:-1], size).contiguous() for out in found)

        n_uniforms_given = kind is tuple and len(inputs) > 3 * n_directions + len(layout)
        name = f"{kernel.__name__.strip('_')} of {type(bsdf).__name__}"
        message = f"torchms.compile: {name}, {type(bsdf.scattering).__name__} of {bsdf.max_order} orders"
        start = time.perf_counter()
        with _console.status(f"{message} …") if self.verbose else _Quiet():
            # Walks ask whether a gradient is wanted, so what is traced wants what the call wants.
            wanted = torch.is_grad_enabled()
            examples = [x.detach().requires_grad_(wanted and x.requires_grad) for x in inputs]
            # Tensors that are no parameters, such as tables, become constants of the graph.
            graph = make_fx(flat, tracing_mode="fake", _allow_non_fake_inputs=True)(*examples)
            graph.graph = fx_graph_cse(graph.graph)
            graph.graph.eliminate_dead_code()
            graph.recompile()
            function = torch.compile(graph, dynamic=False, fullgraph=True, options=OPTIONS)
            function(*inputs)
        if self.verbose:
            _console.print(f"{message}: {time.perf_counter() - start:.0f} s", highlight=False)
        return function


class _Quiet:
    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


class _Columns:
    """(N, rows) elements as columns of a fixed `size`, padded with copies of the last one."""

    def __init__(self, shape: tuple[int, int], size: int) -> None:
        self.shape, self.size = shape, size
        self.count = shape[0] * shape[1]

    def of(self, x: Tensor) -> Tensor:
        """(…, 1 or N, 1 or rows) as (…, size), contiguous."""
        lead = x.shape[:-2]
        x = x.expand(*lead, *self.shape).reshape(*lead, self.count)
        if self.count < self.size:
            x = torch.cat([x, x[..., -1:].expand(*lead, self.size - self.count)], -1)
        return x.contiguous()

    def numbers(self, numbers: Sequence[Tensor]) -> list[Tensor]:
        """Random numbers, or where they come from."""
        if isinstance(numbers, StreamNumbers):
            found = [self.of(numbers.seeds[None]), self.of(numbers.paths[:, None])]
            if numbers.points is not None:
                found.append(self.of(numbers.points[:, :, None]))
            return found
        return [self.of(torch.stack(tuple(numbers)))] if len(numbers) else []

    def parameter(self, p: Tensor, channels: bool) -> Tensor:
        """A parameter map (rows) or (rows, C) as (size) or (C, size)."""
        return self.of(p.T[:, None] if channels else p[None])

    def back(self, out: Tensor, per_path: bool) -> Tensor:
        """(…, size) as (…, rows), mean over the paths, or (…, N, rows); (…, 1, size) comes in if `per_path`."""
        lead = out.shape[:-2] if per_path else out.shape[:-1]
        out = out.reshape(*lead, self.size)[..., : self.count]
        if self.shape[0] == 1 and not per_path:
            return out
        out = out.reshape(*lead, *self.shape)
        return out if per_path else out.mean(-2)
