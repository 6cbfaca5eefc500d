"""What tells one program of machine code from another: everything that a kernel may branch on in Python."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import nn
from torch.nn.utils import parametrize

from torchms.evaluation.kernel import Kernel


@dataclass(frozen=True)
class Input:
    """A tensor that a program takes. role: "direction", "number", "seed", "point", "map" or "shared"; columns: its numbers
    of one element, or its shape if all elements share it."""

    role: str
    name: str
    dtype: torch.dtype
    columns: tuple[int, ...]


@dataclass(frozen=True)
class Signature:
    """Of a program: the kernel, the structure of its BSDF, and its inputs, whose values do not count.

    default: torch's default dtype, which numbers become. exact: whether it rounds like eager code.
    """

    kernel: Kernel
    structure: tuple[Any, ...]
    inputs: tuple[Input, ...]
    n_uniforms: int
    default: torch.dtype
    exact: bool


def structure(part: nn.Module, identified: list[Any], without: tuple[str, ...] = ()) -> tuple[Any, ...]:
    """All that a kernel may branch on in Python, parts included: classes, attributes, which tensors there are.

    Equal for two modules that differ in the values of their tensors only. What is told by its identity, because it cannot
    be compared, is added to `identified`. Attributes named in `without` do not count.
    """
    unseen = {*OF_ANY_MODULE, *without}
    computed = part._modules.get("parametrizations") if parametrize.is_parametrized(part) else None
    tensors = {**part._buffers, **part._parameters}
    if computed is not None:
        tensors |= dict.fromkeys(computed._modules, part)
    return (
        type(part) if computed is None else type(part).__mro__[1],
        tuple((name, _frozen(v, identified)) for name, v in vars(part).items() if name not in unseen),
        tuple(sorted((name, x is None) for name, x in tensors.items())),
        tuple(
            (name, structure(child, identified, without))
            for name, child in part._modules.items()
            if child is not None and child is not computed
        ),
    )


OF_ANY_MODULE = frozenset(vars(nn.Module()))


def _frozen(value: Any, identified: list[Any]) -> Any:
    """`value` as something that can be compared for equality later."""
    if value is None or isinstance(value, bool | int | float | str | type):
        return type(value), value
    if isinstance(value, list | tuple):
        return type(value), tuple(_frozen(v, identified) for v in value)
    if isinstance(value, dict):
        return tuple((k, _frozen(v, identified)) for k, v in value.items())
    if type(value).__hash__ not in (None, object.__hash__):
        return type(value), value
    identified.append(value)
    return id(value)
