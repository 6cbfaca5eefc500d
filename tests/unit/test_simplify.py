"""Programs that leave out guards: the same results, whatever the masks are."""

import itertools

import pytest

from torchms.machine.program import Program
from torchms.machine.simplify import simplified

MEANING = {
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": lambda a: not a,
    "where": lambda mask, a, b: a if mask else b,
}


def result(program: Program, columns: list[float]) -> float:
    """The first result for these inputs."""
    values: list[float] = []
    for name, _, arguments in program.operations:
        taken = [columns[arguments[0]]] if name == "column" else [values[a] for a in arguments]
        values.append(taken[0] if name == "column" else MEANING[name](*taken))
    return values[program.results[0]]


@pytest.mark.parametrize("negated", [False, True])
@pytest.mark.parametrize("outer_first", [False, True])
@pytest.mark.parametrize("joined", ["and", "or"])
def test_choices_within_choices(joined, outer_first, negated):
    """where(x joined y, where(x, a, b), c) on either side: both masks hold where an and does, and fail where an or does."""
    program = Program()
    x, y = (program.add("column", "b", k) for k in (0, 1))
    a, b, c = (program.add("column", "f", k) for k in (2, 3, 4))
    inner = program.add("where", "f", x, a, b)
    mask = program.add(joined, "b", x, y)
    mask = program.add("not", "b", mask) if negated else mask
    program.results = [program.add("where", "f", mask, *((inner, c) if outer_first else (c, inner)))]
    less = simplified(program, fast=True)
    for masks in itertools.product([False, True], repeat=2):
        given = [*masks, 1.0, 2.0, 3.0]
        assert result(less, given) == result(program, given), masks
    idle = (joined == "and") == (outer_first != negated)
    assert sum(o.name == "where" for o in less.operations) == (1 if idle else 2)
