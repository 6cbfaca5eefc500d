"""The numbers of a module by name: those that it declares, its other tensors, and a copy with some of them replaced.

A name is the dotted path of a tensor, "distribution.alpha" or "scattering.network.0.weight", in the order in which the
parts were assigned. Parts are looked for in children of any kind, an `nn.ModuleDict` or a network included.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple, TypeVar

from torch import Tensor, nn

from torchms.parameters.declared import Parameter, Parametric

M = TypeVar("M", bound=nn.Module)

PARAMETRIZATIONS = "parametrizations"
"""Where `torch.nn.utils.parametrize` keeps what tensors are computed from; asked for by name, many times a call."""


class Declared(NamedTuple):
    """A parameter that has a value: what was declared of it, and the value, (*batch) or (*batch, C)."""

    record: Parameter
    value: Tensor


def declarations(module: nn.Module) -> Iterator[tuple[str, Parameter, Tensor | None]]:
    """Name, record and value of every parameter that `module` or a part declares; None for one that follows another."""
    for path, part in _parts(module):
        if isinstance(part, Parametric):
            tensors = part._parameters | part._buffers
            for name, record in part.declared.items():
                yield path + name, record, tensors[name] if name in tensors else getattr(part, name)


def parameters(module: nn.Module) -> dict[str, Declared]:
    """The declared parameters of `module` and its parts that have a value."""
    return {name: Declared(record, value) for name, record, value in declarations(module) if value is not None}


def weights(module: nn.Module) -> dict[str, Tensor]:
    """The tensors of `module` and its parts that are no declared parameters: tables, the weights of a network."""
    found = {}
    for path, part in _parts(module):
        declared = part.declared if isinstance(part, Parametric) else {}
        tensors: dict[str, Tensor | None] = {**part._parameters, **part._buffers}
        computed = part._modules.get(PARAMETRIZATIONS)
        if computed is not None:
            tensors |= {name: getattr(part, name) for name in computed._modules}
        found |= {path + name: x for name, x in tensors.items() if x is not None and name not in declared}
    return found


def with_parameters(module: M, values: Mapping[str, Tensor]) -> M:
    """A shallow copy of `module` with these tensors, of `parameters` or `weights`, in place of its own.

    Graphs are kept, nothing is validated and `module` is not touched; parts in which nothing is replaced are shared with
    it. Raises KeyError for a name of which there is no tensor.
    """
    if not values:
        return module
    here: dict[str, Tensor] = {}
    below: dict[str, dict[str, Tensor]] = {}
    for name, value in values.items():
        head, dot, rest = name.partition(".")
        if dot:
            below.setdefault(head, {})[rest] = value
        else:
            here[name] = value
    clone = object.__new__(class_of(module))
    clone.__dict__.update(module.__dict__)
    clone._parameters, clone._buffers, clone._modules = (
        dict(module._parameters),
        dict(module._buffers),
        dict(module._modules),
    )
    computed = clone._modules.pop(PARAMETRIZATIONS, None)
    if computed is not None:
        # What is computed from another tensor becomes the tensor that it is now.
        here = {name: getattr(module, name) for name in computed._modules} | here
        clone._buffers |= dict.fromkeys(here)
    for name, value in here.items():
        if name not in clone._parameters and name not in clone._buffers:
            raise KeyError(f"{type(module).__name__} has no tensor {name!r}")
        clone._parameters.pop(name, None)
        clone._buffers[name] = value
    for name, some in below.items():
        child = module._modules.get(name)
        if child is None:
            raise KeyError(f"{type(module).__name__} has no part {name!r}")
        clone._modules[name] = with_parameters(child, some)
    return clone


def class_of(module: nn.Module) -> type:
    """The class of `module`, without what `torch.nn.utils.parametrize` adds to it."""
    return type(module).__mro__[1] if PARAMETRIZATIONS in module._modules else type(module)


def _parts(module: nn.Module, path: str = "") -> Iterator[tuple[str, nn.Module]]:
    """`module` and all that is in it, before what is in that, each with the path in front of the names of its tensors."""
    yield path, module
    for name, child in module._modules.items():
        if child is not None and name != PARAMETRIZATIONS:
            yield from _parts(child, f"{path}{name}.")
