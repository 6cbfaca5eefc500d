"""Multiple-bounce microfacet BSDFs in PyTorch.

Names are loaded when they are first used, so that `torchms --help` need not wait for torch.
"""

import sys
from importlib import import_module
from inspect import ismodule
from typing import TYPE_CHECKING, Any

from torchms.version import __version__ as __version__

if TYPE_CHECKING:
    from torchms import approximations as approximations
    from torchms import dropins as dropins
    from torchms import fresnel as fresnel
    from torchms import lobes as lobes
    from torchms import measured as measured
    from torchms import microsurface as microsurface
    from torchms import mitsuba as mitsuba
    from torchms import onnx as onnx
    from torchms import render as render
    from torchms import shading as shading
    from torchms import testing as testing
    from torchms.approximations import *
    from torchms.bsdfs import *
    from torchms.bsdfs.compile import compile as compile
    from torchms.citations import cite as cite
    from torchms.distributions import *
    from torchms.estimators import *
    from torchms.evaluation.arguments import set_validation as set_validation
    from torchms.parameters.constrain import constrain as constrain
    from torchms.paths.segments import *
    from torchms.sampling.stream import Stream as Stream
    from torchms.shading import alpha as alpha
    from torchms.shading import alphas as alphas

_PARTS = ("paths.segments", "distributions", "estimators", "approximations", "bsdfs")
"""Packages of which every name is offered here, too: what such a package imports is public, in a line each."""

_HOME = {
    "Stream": "sampling.stream",
    "alpha": "shading",
    "alphas": "shading",
    "cite": "citations",
    "compile": "bsdfs.compile",
    "constrain": "parameters.constrain",
    "set_validation": "evaluation.arguments",
}
_NEXT_TO_LOOK = ("fresnel", "shading", "lobes", "microsurface", "render")
"""Modules whose names are looked for where one is not here."""
_MODULES = (
    "approximations",
    "dropins",
    "fresnel",
    "lobes",
    "measured",
    "microsurface",
    "mitsuba",
    "onnx",
    "render",
    "shading",
    "testing",
)


def _offered(part: str) -> dict[str, Any]:
    """Names and values of a package's public names."""
    names = vars(import_module(f"torchms.{part}"))
    return {name: value for name, value in names.items() if not (name.startswith("_") or ismodule(value))}


if not TYPE_CHECKING:  # which then tell of names that do not exist

    def __getattr__(name: str) -> Any:
        if name == "__all__":
            return sorted({"__version__", *_HOME, *_MODULES}.union(*map(_offered, _PARTS)))
        if name in _MODULES:
            return import_module(f"torchms.{name}")
        if name in _HOME:
            globals()[name] = getattr(import_module(f"torchms.{_HOME[name]}"), name)
            return globals()[name]
        for part in () if name.startswith("_") else _PARTS:
            if name in (offered := _offered(part)):
                globals()[name] = offered[name]
                return offered[name]
        elsewhere = () if name.startswith("_") else _NEXT_TO_LOOK
        hint = "".join(
            f"; it is torchms.{part}.{name}"
            for part in elsewhere
            if name in getattr(import_module(f"torchms.{part}"), "__all__", _offered(part))
        )
        raise AttributeError(f"module 'torchms' has no attribute {name!r}{hint}", name=name, obj=sys.modules[__name__])

    def __dir__() -> list[str]:
        return __getattr__("__all__")
