"""Programs that leave out guards: the same results, whatever the masks are."""

import itertools
import math

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
        places = [int(a) for a in arguments]
        values.append(columns[places[0]] if name == "column" else MEANING[name](*(values[i] for i in places)))
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


COMPARED = {
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
}
FLOATS = {"neg": lambda a: -a, "mul": lambda a, b: a * b, "add": lambda a, b: a + b, "sub": lambda a, b: a - b}
MEANING |= COMPARED | FLOATS | {"abs": abs}


@pytest.mark.parametrize("negated", [False, True])
@pytest.mark.parametrize("inner", COMPARED)
@pytest.mark.parametrize("outer", COMPARED)
def test_comparisons_within_comparisons(outer, inner, negated):
    """where(x ∘ y, where(±x ∘ y, a, b), c): what one comparison says of another, NaN included."""
    program = Program()
    x, y, a, b, c = (program.add("column", "f", k) for k in range(5))
    left, right = (program.add("neg", "f", v) if negated else v for v in (x, y))
    within = program.add("where", "f", program.add(inner, "b", left, right), a, b)
    program.results = [program.add("where", "f", program.add(outer, "b", x, y), within, c)]
    less = simplified(program, fast=False)
    for pair in itertools.product([-1.0, -0.0, 0.0, 1.0, math.nan], repeat=2):
        given = [*pair, 1.0, 2.0, 3.0]
        assert result(less, given) == result(program, given), pair


@pytest.mark.parametrize("operation", ["mul", "add", "sub"])
@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_negated_numbers(first, second, operation):
    """±x ∘ ±y, and the absolute of it, keep their values, and a square needs no sign."""
    program = Program()
    x, y = (program.add("column", "f", k) for k in range(2))
    a, b = (program.add("neg", "f", v) if given else v for v, given in ((x, first), (y, second)))
    program.results = [program.add("abs", "f", program.add(operation, "f", a, b))]
    less = simplified(program, fast=False)
    for pair in itertools.product([-2.0, 0.0, 3.0], repeat=2):
        assert result(less, list(pair)) == result(program, list(pair))
    square = Program()
    turned = square.add("neg", "f", square.add("column", "f", 0))
    square.results = [square.add("abs", "f", square.add("mul", "f", turned, turned))]
    assert [o.name for o in simplified(square, fast=False).operations] == ["column", "mul"]
