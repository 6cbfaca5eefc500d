"""A BSDF from the text of the Python expression that builds it; nothing else is evaluated."""

import ast
import inspect
from typing import Any

from torch import nn

import torchms
from torchms import fresnel
from torchms.bsdfs.base import BSDF

METHODS = ("load", "metal")
"""Alternative constructors that may be called on a class."""


def constructors() -> dict[str, type]:
    """The public classes of torchms and torchms.fresnel that a BSDF is built of."""
    found = {}
    for module in (torchms, fresnel):
        for name in dir(module):
            value = getattr(module, name)
            if inspect.isclass(value) and issubclass(value, nn.Module) and not inspect.isabstract(value):
                found[name] = value
    return found


def parse_bsdf(text: str) -> BSDF:
    """The BSDF that `text` describes, such as "RoughConductor(GGX(0.3, 0.1), Conductor.metal('Au'))".

    Calls of the public constructors with numbers, strings, lists and each other. Raises ValueError for anything else,
    and whatever the constructors raise for arguments that do not fit.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        raise _refused(text, f"{error.msg} at column {error.offset}") from None
    bsdf = _value(tree, text, constructors())
    if not isinstance(bsdf, BSDF):
        raise _refused(text, f"it is a {type(bsdf).__name__}, not a BSDF")
    return bsdf


def _value(node: ast.expr, text: str, known: dict[str, type]) -> Any:
    match node:
        case ast.Constant(value=value) if value is None or isinstance(value, bool | int | float | str):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=value)) if isinstance(value, int | float):
            return -value
        case ast.List(elts=elements) | ast.Tuple(elts=elements):
            return [_value(element, text, known) for element in elements]
        case ast.Call(func=function, args=arguments, keywords=keywords):
            values = [_value(argument, text, known) for argument in arguments]
            named = {}
            for keyword in keywords:
                if keyword.arg is None:
                    raise _refused(text, "** cannot be used here")
                named[keyword.arg] = _value(keyword.value, text, known)
            return _constructor(function, text, known)(*values, **named)
    raise _refused(text, f"{ast.unparse(node)!r} is neither a number, a string, a list nor a constructor's call")


def _constructor(node: ast.expr, text: str, known: dict[str, type]) -> Any:
    match node:
        case ast.Name(id=name) if name in known:
            return known[name]
        case ast.Attribute(value=ast.Name(id=name), attr=method) if name in known and method in METHODS:
            return getattr(known[name], method)
    raise _refused(text, f"{ast.unparse(node)!r} is not a constructor")


def _refused(text: str, reason: str) -> ValueError:
    return ValueError(
        f"--bsdf {text!r} does not describe a BSDF: {reason}. "
        "Write it as in Python, for example \"RoughConductor(GGX(0.3), Conductor.metal('Au'))\"; "
        f"known: {', '.join(sorted(constructors()))}."
    )
