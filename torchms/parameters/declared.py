"""Parameters of a batch: how a module declares, checks and stores the numbers that describe a surface."""

import inspect
import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn

from torchms.maths.numerics import has_values, widened

Value = float | int | list[Any] | tuple[Any, ...] | Tensor
"""What a constructor takes for a parameter: a number, a list of channels, or a tensor, (*batch) or (*batch, C)."""


def first_bad(bad: Tensor, value: Tensor) -> str:
    """`value` and index of the first element where `bad` holds, for an error message."""
    flat = int(torch.argmax(bad.reshape(-1).to(torch.uint8)))
    index = tuple(int(i) for i in torch.unravel_index(torch.tensor(flat), bad.shape)) if bad.ndim else ()
    number = float(value.detach().reshape(-1)[flat])
    return f"{number:g} at index {index}" if index else f"{number:g}"


@dataclass(frozen=True)
class Parameter:
    """What a module declares of a number that describes it.

    name: its attribute. argument: what the constructor calls it. channels: whether its last axis is that of the channels.
    low, high: the range, without `low` itself if `open_low`. remedy: what to do about a value outside, as a sentence.
    """

    name: str
    argument: str
    channels: bool
    low: float
    high: float
    open_low: bool
    remedy: str = field(default="", compare=False)

    @property
    def range(self) -> str:
        """The range as text, [0, 1] or (0, 10]."""
        return f"{'(' if self.open_low else '['}{self.low:g}, {self.high:g}]"

    def outside(self, value: Tensor) -> Tensor:
        """Where `value` is not in the range, or NaN."""
        below = (value <= self.low) if self.open_low else (value < self.low)
        return below | (value > self.high) | torch.isnan(value)

    def ends(self, dtype: torch.dtype) -> tuple[float, float]:
        """The least and the greatest number of this dtype in the range."""
        low, high = torch.tensor([self.low, self.high], dtype=dtype)
        if self.open_low:
            low = torch.nextafter(low, torch.full_like(low, math.inf))
        return float(low), float(high)

    def batch(self, value: Tensor) -> torch.Size:
        """The shape of `value` without the axis of the channels."""
        return value.shape[:-1] if self.channels else value.shape


class Parametric(nn.Module):
    """A module whose numbers may be scalars, batches or per-pixel maps.

    A float or a tensor becomes a buffer (its autograd graph is kept), an `nn.Parameter` stays one. A parameter has
    shape `*batch`, or `*batch C` if it carries channels.
    """

    most_at_once = 1 << 16
    """Rows × paths up to which larger blocks are faster in eager code."""

    def __init__(self) -> None:
        super().__init__()
        self.declared: dict[str, Parameter] = {}

    def declare(
        self,
        name: str,
        value: Value | None,
        *,
        low: float,
        high: float,
        remedy: str,
        open_low: bool = False,
        channels: bool = False,
        optional: bool = False,
        argument: str | None = None,
    ) -> None:
        """Check `value` and register it as `name`; `argument` is what the constructor calls it, if not `name`.

        None is a value only if it is `optional`. Tensors shorter than float32, as a network gives under autocast, become
        float32. Raises ValueError with the name, the value, the allowed range and the `remedy` if an element is outside
        [low, high] (or (low, high] if `open_low`) or NaN, or if there is no channel; TypeError if it is not a real number
        or tensor.
        """
        record = Parameter(name, argument or name, channels, float(low), float(high), open_low, remedy)
        self.declared[name] = record
        if value is None and optional:
            self.register_buffer(name, None)
            return
        label = f"{type(self).__name__}({record.argument}=...)"
        if isinstance(value, Tensor):
            tensor = value
        elif isinstance(value, bool) or not isinstance(value, int | float | list | tuple):
            kind = "None" if value is None else type(value).__name__
            array = " Write torch.as_tensor(…, dtype=torch.float32)." if hasattr(value, "__array__") else ""
            raise TypeError(f"{label} must be a float, a Tensor or an nn.Parameter; got {kind}.{array}")
        elif isinstance(value, list | tuple) and not channels:
            raise TypeError(
                f"{label} must be one number, or a tensor of one for every element of a batch; got {value!r}. "
                f"{self._remedy_of_list(value)}"
            )
        else:
            try:
                tensor = torch.tensor(value, dtype=torch.get_default_dtype())
            except (TypeError, ValueError) as error:
                raise TypeError(f"{label} must hold real numbers, as many in each row; got {value!r}.") from error
        if not tensor.is_floating_point():
            if tensor.is_complex():
                raise TypeError(f"{label} must be real; got {tensor.dtype}.")
            tensor = tensor.to(torch.get_default_dtype())
        if not isinstance(tensor, nn.Parameter):
            tensor = widened(tensor)
        if channels and tensor.ndim == 0:
            tensor = tensor.reshape(1)
        if channels and tensor.shape[-1] == 0:
            raise ValueError(f"{label} must have at least one channel, on its last axis; got {tuple(tensor.shape)}.")
        if has_values(tensor):
            bad = record.outside(tensor.detach())
            if bool(bad.any()):
                raise ValueError(f"{label} must lie in {record.range}; got {first_bad(bad, tensor)}. {remedy}")
        if isinstance(tensor, nn.Parameter):
            self.register_parameter(name, tensor)
        else:
            self.register_buffer(name, tensor)

    def _remedy_of_list(self, value: list[Any] | tuple[Any, ...]) -> str:
        """What to write for a list where a number stands: it may mean several arguments, or a batch."""
        arguments = list(inspect.signature(type(self)).parameters)[: len(value)]
        batch = f"torch.tensor({list(value)})"
        if 2 <= len(value) <= len(arguments):
            together = f"{type(self).__name__}({', '.join(map(repr, value))})"
            return f"Write {together} for {' and '.join(arguments)}, {batch} for a batch."
        return f"Write {batch} for a batch."

    def parameter_batch_shapes(self) -> list[torch.Size]:
        """Batch shapes of all declared parameters, children included, without the channel axes."""
        shapes = []
        for module in self.modules():
            if isinstance(module, Parametric):
                for name, record in module.declared.items():
                    value = getattr(module, name)
                    if value is not None:
                        shapes.append(record.batch(value))
        return shapes


def channels_first(value: Tensor, ndim: int) -> Tensor:
    """A `*batch C` parameter as (C, 1…, *batch) with `ndim` axes after the channels."""
    batch = value.shape[:-1]
    return value.movedim(-1, 0).reshape((value.shape[-1],) + (1,) * (ndim - len(batch)) + tuple(batch))


def describe(module: nn.Module) -> str:
    """One-line description of a parametric module's numbers, for `extra_repr`."""
    parts = []
    for name in getattr(module, "declared", {}):
        value = getattr(module, name)
        if value is None:
            continue
        if value.numel() <= 4 and not value.is_meta:
            parts.append(f"{name}={_short(value.detach().tolist())}")
        else:
            parts.append(f"{name}=<{tuple(value.shape)}>")
    return ", ".join(parts)


def _short(number: float | list[Any]) -> str:
    """Numbers, nested or not, to six significant digits: 0.3 for the float32 nearest to it."""
    if isinstance(number, list):
        return f"[{', '.join(_short(each) for each in number)}]"
    return repr(float(f"{number:.6g}"))
