"""What each operation of torch is, element by element, in operations of a `Program`."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.machine.program import KINDS, Grid, Number, Program
from torchms.machine.values import Values, like

UNARY = frozenset(
    (
        *("neg", "abs", "sqrt", "exp", "exp2", "expm1", "log", "log2", "log1p", "erf", "floor", "ceil", "trunc"),
        *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
    )
)
BINARY = {"mul": "mul", "div": "div", "maximum": "max", "minimum": "min", "atan2": "atan2"}
BITS = {"bitwise_and": "and", "logical_and": "and", "__and__": "and", "bitwise_or": "or", "logical_or": "or"}
BITS |= {"__or__": "or", "bitwise_xor": "xor", "logical_xor": "xor", "__xor__": "xor"}
SHIFTS = {"__rshift__": "shr", "bitwise_right_shift": "shr", "__lshift__": "shl", "bitwise_left_shift": "shl"}
COMPARISONS = frozenset(["lt", "le", "gt", "ge", "eq", "ne"])
FOLDS = {"sum": "add", "mean": "add", "amax": "max", "amin": "min", "prod": "mul"}
UNROLLED = 128
"""Numbers of the largest matrix in memory whose products are written out; a larger one has a loop, faster and built sooner."""


def knows(name: str) -> bool:
    """Whether `computed` knows what the operation of this name does."""
    return any(name in table for table in (UNARY, BINARY, BITS, SHIFTS, COMPARISONS, FOLDS, SPECIAL))


def computed(values: Values, name: str, out: Tensor, args: Sequence[Any], kwargs: dict[str, Any]) -> Tensor:
    """The values of `out`, which the operation `name` gave."""
    if name in SPECIAL:
        return SPECIAL[name](values, out, *args, **kwargs)
    if name in FOLDS:
        return _folded(values, name, out, *args, **{k: v for k, v in kwargs.items() if k != "dtype"})
    if name in COMPARISONS:
        dtype = torch.result_type(args[0], args[1])
        return values.each(name, "b", out.shape, *(values.of(a, dtype) for a in args[:2]))
    if kwargs.get("rounding_mode") is not None:
        raise NotImplementedError("a quotient that is rounded")
    operation = name if name in UNARY else {**BINARY, **BITS, **SHIFTS}[name]
    return values.each(operation, KINDS[out.dtype], out.shape, *(values.of(a, out.dtype) for a in args))


def _folded(values: Values, name: str, out: Tensor, x: Tensor, dim: Any = None, keepdim: bool = False) -> Tensor:
    """A sum or the like over axes."""
    found = values.of(x, out.dtype)
    axes = [] if dim is None else [dim] if isinstance(dim, int) else list(dim)
    axes = [d % max(x.ndim, 1) for d in axes] or list(range(x.ndim))
    kept = [d for d in range(x.ndim) if d not in axes]
    if x.ndim:
        found = found.permute(*kept, *axes).reshape(out.numel(), -1)
    totals = []
    for row in found.reshape(out.numel(), -1).tolist():
        total = row[0]
        for value in row[1:]:
            total = values.program.add(FOLDS[name], KINDS[out.dtype], total, value)
        if name == "mean" and len(row) > 1:
            total = values.program.add("mul", KINDS[out.dtype], total, int(values.of(1 / len(row), out.dtype)))
        totals.append(total)
    return like(totals, out.shape)


def _sum(operation: str, reverse: bool = False) -> Any:
    def function(values: Values, out: Tensor, a: Any, b: Any, alpha: Number = 1) -> Tensor:
        if reverse:
            a, b = b, a
        kind, second = KINDS[out.dtype], values.of(b, out.dtype)
        if alpha != 1:
            second = values.each("mul", kind, second.shape, second, values.of(alpha, out.dtype))
        return values.each("or" if kind == "b" else operation, kind, out.shape, values.of(a, out.dtype), second)

    return function


def _inverse(values: Values, out: Tensor, x: Tensor) -> Tensor:
    return values.each("div", KINDS[out.dtype], out.shape, values.of(1, out.dtype), values.of(x, out.dtype))


def _inverse_root(values: Values, out: Tensor, x: Tensor) -> Tensor:
    kind = KINDS[out.dtype]
    root = values.each("sqrt", kind, out.shape, values.of(x, out.dtype))
    return values.each("div", kind, out.shape, values.of(1, out.dtype), root)


def _power(values: Values, out: Tensor, x: Any, exponent: Any) -> Tensor:
    kind, base = KINDS[out.dtype], values.of(x, out.dtype)
    if isinstance(exponent, int | float) and exponent in (2, 3):
        square = values.each("mul", kind, out.shape, base, base)
        return square if exponent == 2 else values.each("mul", kind, out.shape, square, base)
    return values.each("pow", kind, out.shape, base, values.of(exponent, out.dtype))


def _where(values: Values, out: Tensor, mask: Tensor, a: Any, b: Any) -> Tensor:
    operands = values.of(mask, torch.bool), values.of(a, out.dtype), values.of(b, out.dtype)
    return values.each("where", KINDS[out.dtype], out.shape, *operands)


def _clamp(values: Values, out: Tensor, x: Tensor, min: Any = None, max: Any = None) -> Tensor:
    found = values.of(x, out.dtype)
    for limit, name in ((min, "max"), (max, "min")):
        if limit is not None:
            found = values.each(name, KINDS[out.dtype], out.shape, values.of(limit, out.dtype), found)
    return found


def _sign(values: Values, out: Tensor, x: Tensor) -> Tensor:
    zero, one, minus = (values.of(v, out.dtype) for v in (0, 1, -1))
    kind, shape, found = KINDS[out.dtype], out.shape, values.of(x, out.dtype)
    low = values.each("where", kind, shape, values.each("lt", "b", shape, found, zero), minus, zero)
    return values.each("where", kind, shape, values.each("gt", "b", shape, found, zero), one, low)


def _isnan(values: Values, out: Tensor, x: Tensor) -> Tensor:
    return values.each("ne", "b", out.shape, values.of(x), values.of(x))


def _product(values: Values, out: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Of matrices, or of as many of them as the first axis has."""
    left, right = values.of(a, out.dtype).reshape(-1, *a.shape[-2:]), values.of(b, out.dtype).reshape(-1, *b.shape[-2:])
    found = [_of_two(values.program, KINDS[out.dtype], x, y) for x, y in zip(left, right.mT, strict=True)]
    return torch.stack(found).reshape(out.shape)


def _of_two(program: Program, kind: str, rows: Tensor, columns: Tensor) -> Tensor:
    """Inner products of rows and columns: one by one, or in a loop if one side is large and lies in memory."""
    if rows.numel() > UNROLLED and (place := program.grid(rows.tolist())) is not None:
        return torch.stack([_in_loop(program, kind, column, place) for column in columns], 1)
    if columns.numel() > UNROLLED and (place := program.grid(columns.tolist())) is not None:
        return torch.stack([_in_loop(program, kind, row, place) for row in rows])
    return torch.tensor([[_inner(program, kind, row, column) for column in columns.tolist()] for row in rows.tolist()])


def _in_loop(program: Program, kind: str, vector: Tensor, place: Grid) -> Tensor:
    """The product of a matrix in memory and a vector, whose numbers that all elements share are taken before the loop."""
    parts = []
    for wanted in (False, True):
        some = [k for k, v in enumerate(vector.tolist()) if program.varies[v] is wanted]
        if some:
            array = program.add("array", kind, *(int(vector[k]) for k in some))
            first = (place.first[k] for k in some)
            product = program.add("matrix", kind, array, place.tensor, place.down, place.rows, *first)
            parts.append([program.add("element", kind, product, k) for k in range(place.rows)])
    totals = parts[0] if len(parts) == 1 else [program.add("add", kind, *pair) for pair in zip(*parts, strict=True)]
    return torch.tensor(totals)


def _inner(program: Program, kind: str, a: list[int], b: list[int]) -> int:
    total: int | None = None
    for x, y in zip(a, b, strict=True):
        term = program.add("mul", kind, x, y)
        total = term if total is None else program.add("add", kind, total, term)
    assert total is not None
    return total


def _running(values: Values, out: Tensor, x: Tensor, dim: int, dtype: torch.dtype | None = None) -> Tensor:
    """Sums of all elements up to each along an axis."""
    columns = values.of(x, out.dtype).movedim(dim, 0)
    totals = [columns[0]]
    for column in columns[1:]:
        totals.append(values.each("add", KINDS[out.dtype], column.shape, totals[-1], column))
    return torch.stack(totals).movedim(0, dim)


def _affine(
    values: Values, out: Tensor, bias: Tensor, a: Tensor, b: Tensor, beta: Number = 1, alpha: Number = 1
) -> Tensor:
    if beta != 1 or alpha != 1:
        raise NotImplementedError("addmm with factors")
    return values.each("add", KINDS[out.dtype], out.shape, values.of(bias, out.dtype), _product(values, out, a, b))


SPECIAL: dict[str, Any] = {
    "add": _sum("add"),
    "sub": _sum("sub"),
    "rsub": _sum("sub", reverse=True),
    "reciprocal": _inverse,
    "rsqrt": _inverse_root,
    "pow": _power,
    "where": _where,
    "masked_fill": lambda values, out, x, mask, value: _where(values, out, mask, value, x),
    "clamp": _clamp,
    "clamp_min": _clamp,
    "clamp_max": lambda values, out, x, max: _clamp(values, out, x, None, max),
    "bitwise_not": lambda values, out, x: values.each("not", KINDS[out.dtype], out.shape, values.of(x)),
    "logical_not": lambda values, out, x: values.each("not", "b", out.shape, values.of(x, torch.bool)),
    "sign": _sign,
    "sgn": _sign,
    "isnan": _isnan,
    "_to_copy": lambda values, out, x, **_: values.of(x, out.dtype),
    "copy": lambda values, out, x, source, *_: values.of(source, out.dtype).expand(out.shape),
    "mm": _product,
    "bmm": _product,
    "addmm": _affine,
    "cumsum": _running,
}
