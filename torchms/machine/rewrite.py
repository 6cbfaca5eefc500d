"""An operation, or one that gives the same for less."""

from torchms.machine.program import Number, Program

FLIPPED = {"lt": "gt", "gt": "lt", "le": "ge", "ge": "le", "eq": "eq", "ne": "ne"}
"""Comparisons when both sides are negated."""
NOT_NEGATIVE = frozenset(("abs", "sqrt", "exp", "exp2", "inverse_root"))


def added(new: Program, name: str, kind: str, arguments: list, fast: bool) -> int:
    """The value of an operation on values of `new`: the same bits, or, if `fast`, within a few units in the last place."""
    if name == "where":
        mask, a, b = arguments
        return _choice(new, kind, mask, a, b, fast)
    if name in FLIPPED:
        return _comparison(new, name, *arguments)
    if name in ("add", "sub") and kind in "fd":
        return _sum(new, name, kind, *arguments)
    if name == "neg" and (inner := _negated(new, arguments[0])) is not None:
        return inner
    if name == "abs":
        return _absolute(new, kind, arguments[0])
    if fast and name == "and" and kind == "i" and (shifted := _logical_shift(new, *arguments)) is not None:
        return shifted
    if name == "mul" and kind in "fd":
        return _product(new, kind, *arguments)
    if fast and name == "div" and kind in "fd":
        return _quotient(new, kind, *arguments)
    return new.add(name, kind, *arguments)


def _negated(new: Program, value: int) -> int | None:
    """x, if the value is −x."""
    operation = new.operations[value]
    return int(operation.arguments[0]) if operation.name == "neg" and operation.kind in "fd" else None


def _opposite(new: Program, value: int) -> int | None:
    """−x if that is there already, or a plain number."""
    inner = _negated(new, value)
    number = new.constant(value)
    kind = new.operations[value].kind
    if inner is None and number is not None and kind in "fd":
        # One zero, so that comparisons with it are the same value.
        return new.number(-number if number else 0.0, kind)
    return inner


def _choice(new: Program, kind: str, mask: int, a: int, b: int, fast: bool) -> int:
    if a == b:
        return a
    name, _, compared = new.operations[mask]
    if fast and kind in "fd" and name in ("lt", "le", "gt", "ge") and new.constant(int(compared[1])) == 0:
        # where(x < 0, −x, x) but for the sign of a zero.
        x = int(compared[0])
        positive, negative = (b, a) if name in ("lt", "le") else (a, b)
        if positive == x and _negated(new, negative) == x:
            return _absolute(new, kind, x)
    return new.add("where", kind, mask, a, b)


def _comparison(new: Program, name: str, a: int, b: int) -> int:
    """−x < c as x > −c: the same comparison is the same value then."""
    left, right = _negated(new, a), _opposite(new, b)
    if left is not None and right is not None:
        return new.add(FLIPPED[name], "b", left, right)
    if _is_zero(new, b):
        b = new.number(0.0, new.operations[b].kind)
    return new.add(name, "b", a, b)


def _is_zero(new: Program, value: int) -> bool:
    return new.operations[value].kind in "fd" and new.constant(value) == 0


def _sum(new: Program, name: str, kind: str, a: int, b: int) -> int:
    """a + (−b) is a − b, bit for bit, and the like."""
    other = _negated(new, b)
    if other is not None:
        return new.add("sub" if name == "add" else "add", kind, a, other)
    first = _negated(new, a)
    if first is not None and name == "add":
        return new.add("sub", kind, b, first)
    return new.add(name, kind, a, b)


def _absolute(new: Program, kind: str, x: int) -> int:
    inner = _negated(new, x)
    if inner is not None:
        x = inner
    name, _, arguments = new.operations[x]
    if name in NOT_NEGATIVE or (name == "mul" and arguments[0] == arguments[1]):
        return x
    return new.add("abs", kind, x)


def _logical_shift(new: Program, a: int, b: int) -> int | None:
    """(x >> k) & (2^(32 − k) − 1), which is one shift that brings zeros in."""
    for shifted, mask in ((a, b), (b, a)):
        name, _, arguments = new.operations[shifted]
        if name == "shr":
            k = new.constant(int(arguments[1]))
            if k is not None and new.constant(mask) == (1 << (32 - int(k))) - 1:
                return new.add("ushr", "i", *arguments)
    return None


def _product(new: Program, kind: str, a: int, b: int) -> int:
    ones: list[Number | None] = [new.constant(a), new.constant(b)]
    if 1.0 in ones:
        return b if ones[0] == 1.0 else a
    if a == b and new.operations[a].name == "abs":
        a = b = int(new.operations[a].arguments[0])
    x, y = _negated(new, a), _negated(new, b)
    found = new.add("mul", kind, a if x is None else x, b if y is None else y)
    return found if (x is None) == (y is None) else new.add("neg", kind, found)


def _quotient(new: Program, kind: str, a: int, b: int) -> int:
    """a / b as a product with an inverse that is computed once a call, or together with a root."""
    below = new.operations[b]
    if a == b and not new.varies[a]:
        return new.number(1.0, kind)
    if below.name == "sqrt" and kind == "f":
        inverse = new.add("inverse_root", kind, *below.arguments)
    elif not new.varies[b] and new.varies[a]:
        inverse = new.add("div", kind, new.number(1.0, kind), b)
    else:
        return new.add("div", kind, a, b)
    return _product(new, kind, a, inverse)
