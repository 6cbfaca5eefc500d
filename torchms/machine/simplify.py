"""A program without what it need not do: guards of numbers that are not looked at, quotients by what all elements share.

Kernels guard the argument of a function, so that gradients are finite: where(ok, √(where(ok, x, 1)), 0). In machine code,
where nothing is differentiated any more, the inner choice is idle: the outer one drops what it would have prevented.
"""

from torchms.machine.program import Program
from torchms.machine.rewrite import added
from torchms.machine.truths import Literals, implied, truth


def simplified(program: Program, fast: bool) -> Program:
    """A program with the same results: the same bits, or, if `fast`, within a few units in the last place."""
    # Written anew first, so that the same comparison is the same value; and again for what is idle only then.
    for same in ({}, None, None):
        program = _written(program, _guards(program) if same is None else same, fast)
    return program


def _written(program: Program, same: dict[int, int], fast: bool) -> Program:
    """The program with values in place of those that are the `same`, operation by operation."""
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
            moved[value] = added(new, operation.name, operation.kind, [*operands, *others], fast)
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
            made = truth(program, mask, known)
            if made is not None:
                same[value] = a if made else b
                look(same[value], known)
                continue
            look(mask, known)
            look(a, known | implied(program, mask, True))
            look(b, known | implied(program, mask, False))
        else:
            for argument in program.taken(operation):
                look(argument, known)
    return same
