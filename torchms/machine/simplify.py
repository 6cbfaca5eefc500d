"""A program without what it need not do: guards of numbers that are not looked at, quotients by what all elements share.

Kernels guard the argument of a function, so that gradients are finite: where(ok, √(where(ok, x, 1)), 0). In machine code,
where nothing is differentiated any more, the inner choice is idle: the outer one drops what it would have prevented.
"""

from torchms.machine.program import Program

Literals = frozenset[tuple[int, bool]]
"""Masks, and what they are."""


def simplified(program: Program, fast: bool) -> Program:
    """A program with the same results: the same bits, or, if `fast`, within a few units in the last place."""
    same = _guards(program)
    new = Program()
    moved: dict[int, int] = {}
    needed = program.needed()
    for value, operation in enumerate(program.operations):
        # Columns keep their numbers, also those that nothing is made of.
        if operation.name != "column" and (value in same or not needed[value]):
            continue
        taken = program.taken(operation)
        operands = [moved[_final(same, v)] for v in taken]
        others = operation.arguments[len(taken) :]
        if taken:
            moved[value] = _added(new, operation.name, operation.kind, [*operands, *others], fast)
        else:
            moved[value] = new.add(operation.name, operation.kind, *others)
    new.results = [moved[_final(same, v)] for v in program.results]
    return new


def _final(same: dict[int, int], value: int) -> int:
    while value in same:
        value = same[value]
    return value


def _guards(program: Program) -> dict[int, int]:
    """Choices that are always made the same way wherever their result is looked at, and what they give there."""
    operations = program.operations
    # What holds wherever a value is looked at; None for one that is not.
    holds: list[Literals | None] = [None] * len(operations)
    same: dict[int, int] = {}

    def look(value: int, known: Literals) -> None:
        before = holds[value]
        holds[value] = known if before is None else before & known

    for value in program.results:
        look(value, frozenset())
    for value in range(len(operations) - 1, -1, -1):
        known = holds[value]
        if known is None:
            continue
        operation = operations[value]
        if operation.name == "where":
            mask, a, b = (int(v) for v in operation.arguments)
            if (mask, True) in known or (mask, False) in known:
                same[value] = a if (mask, True) in known else b
                look(same[value], known)
                continue
            look(mask, known)
            look(a, known | _implied(program, mask, True))
            look(b, known | _implied(program, mask, False))
        else:
            for argument in program.taken(operation):
                look(argument, known)
    return same


def _implied(program: Program, mask: int, is_true: bool) -> Literals:
    """What is known if a mask is so."""
    found = {(mask, is_true)}
    name, _, arguments = program.operations[mask]
    if name == ("and" if is_true else "or"):
        for argument in arguments:
            found |= _implied(program, int(argument), is_true)
    if name == "not":
        found |= _implied(program, int(arguments[0]), not is_true)
    return frozenset(found)


def _added(new: Program, name: str, kind: str, arguments: list, fast: bool) -> int:
    """The value of an operation, or of one that gives the same for less."""
    if name == "where" and arguments[1] == arguments[2]:
        return arguments[1]
    if name == "neg" and new.operations[arguments[0]].name == "neg":
        return int(new.operations[arguments[0]].arguments[0])
    if name == "mul" and 1.0 in (one := [new.constant(v) for v in arguments]) and kind in "fd":
        return arguments[1 - one.index(1.0)]
    if fast and name == "div" and kind in "fd":
        return _quotient(new, kind, *arguments)
    return new.add(name, kind, *arguments)


def _quotient(new: Program, kind: str, a: int, b: int) -> int:
    """a / b as a product with an inverse that is computed once a call, or together with a root."""
    below = new.operations[b]
    if below.name == "sqrt" and kind == "f":
        inverse = new.add("inverse_root", kind, *below.arguments)
    elif not new.varies[b] and new.varies[a]:
        inverse = new.add("div", kind, new.number(1.0, kind), b)
    else:
        return new.add("div", kind, a, b)
    return _added(new, "mul", kind, [a, inverse], True)
