"""A recorded program as operations of Dr.Jit: the kernels of torchms in Mitsuba's variants, without a second copy of them.

Traced, they become part of Mitsuba's own kernels: in symbolic loops and calls, for any back end, and Dr.Jit differentiates
them. In scalar variants they are Python's numbers, one operation after the other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from torchms.machine.program import Number, Program
from torchms.mitsuba.branches import Branch, Plan, Planner

Value = Any
"""A number of Dr.Jit: an array, or in scalar variants one of Python's."""


class Replay:
    """`program` as a function of its columns, in their order, that gives its results; branches: with those worth it."""

    def __init__(self, program: Program, branches: bool = False) -> None:
        self.program = program
        needed = program.needed()
        self.fused = _fused(program, needed)
        self.constants = [program.constant(v) if need else None for v, need in enumerate(needed)]
        self.planner = Planner(program, self.arguments)
        self.plan = self.planner.plan(branches)

    def arguments(self, v: int) -> tuple[int, ...]:
        """The values that operation v takes."""
        return self.fused[v] if v in self.fused else self.program.taken(self.program.operations[v])

    def __call__(self, columns: Sequence[Value]) -> list[Value]:
        mi = import_module("mitsuba")
        return _Run(self, columns, mi).results(self.plan, {})


class _Run:
    """One replay: the columns, and what operations are."""

    def __init__(self, replay: Replay, columns: Sequence[Value], mi: Any) -> None:
        self.replay, self.columns, self.mi = replay, columns, mi
        self.table = _functions(_is_scalar(mi))

    def results(self, plan: Plan, there: Mapping[int, Value]) -> list[Value]:
        """Those of `plan`, with the values that are there."""
        values = dict(there)
        for step in plan.steps:
            if isinstance(step, Branch):
                values.update(zip(step.results, self._branch(step, values), strict=True))
            else:
                taken = (self.replay.planner.final(a, plan.known) for a in self.replay.arguments(step))
                values[step] = self._operation(step, [values[a] for a in taken])
        return [values[v] for v in plan.results]

    def _branch(self, step: Branch, values: Mapping[int, Value]) -> Sequence[Value]:
        def side(plan: Plan) -> Callable[[], tuple[Value, ...]]:
            return lambda: tuple(self.results(plan, values))

        # In scalar variants only one of them is called.
        return import_module("drjit").if_stmt((), values[step.mask], side(step.yes), side(step.no))

    def _operation(self, v: int, taken: list[Value]) -> Value:
        name, kind, arguments = self.replay.program.operations[v]
        if v in self.replay.fused:
            return self.table["fma"](*taken)
        if name == "column":
            return self.columns[int(arguments[0])]
        if name == "number":
            return _literal(self.mi, self.replay.constants[v], kind)
        if name == "cast":
            return _cast(self.mi, taken[0], kind)
        # Products of masks are masks.
        return self.table["and" if name == "mul" and kind == "b" else name](*taken)


def _fused(program: Program, needed: list[bool]) -> dict[int, tuple[int, int, int]]:
    """Sums of a product that nothing else takes, and what they are of: one operation, and one rounding."""
    uses = [0] * len(needed)
    for v in program.results:
        uses[v] += 1
    for operation, need in zip(program.operations, needed, strict=True):
        if need:
            for v in program.taken(operation):
                uses[v] += 1
    found: dict[int, tuple[int, int, int]] = {}
    for v, operation in enumerate(program.operations):
        if not needed[v] or operation.name != "add" or operation.kind not in "fd":
            continue
        for product, other in (operation.arguments, operation.arguments[::-1]):
            inner = program.operations[int(product)]
            if inner.name == "mul" and uses[int(product)] == 1 and product != other:
                a, b = inner.arguments
                found[v] = int(a), int(b), int(other)
                needed[int(product)] = False
                break
    return found


def _is_scalar(mi: Any) -> bool:
    return mi.Float is float


def _literal(mi: Any, value: Number | None, kind: str) -> Value:
    assert value is not None
    return mi.Bool(bool(value)) if kind == "b" else mi.Float(float(value))


def _cast(mi: Any, value: Value, kind: str) -> Value:
    """A mask as a number, or the reverse; among floating numbers there is one width, the variant's."""
    if kind in "il":
        raise NotImplementedError("Kernels that compute with integers cannot be replayed in Dr.Jit.")
    dr = import_module("drjit")
    if kind == "b":
        return value != 0
    return dr.select(value, mi.Float(1), mi.Float(0)) if isinstance(value, bool | mi.Bool) else value


def _functions(scalar: bool) -> dict[str, Callable[..., Value]]:
    """What an operation of a program is in Dr.Jit, whose functions take Python's numbers as well."""
    dr = import_module("drjit")
    found: dict[str, Callable[..., Value]] = {
        name: getattr(dr, name)
        for name in (
            *("abs", "sqrt", "exp", "exp2", "log", "log2", "floor", "ceil", "trunc", "erf", "fma", "detach"),
            *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
        )
    }
    found |= {"where": dr.select, "max": dr.maximum, "min": dr.minimum, "pow": dr.power}
    found |= {
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "div": _quotient if scalar else lambda a, b: a / b,
        "neg": lambda a: -a,
        "and": lambda a, b: a & b,
        "or": lambda a, b: a | b,
        "xor": lambda a, b: a ^ b,
        "not": (lambda a: not a) if scalar else lambda a: ~a,
        "lt": lambda a, b: a < b,
        "le": lambda a, b: a <= b,
        "gt": lambda a, b: a > b,
        "ge": lambda a, b: a >= b,
        "eq": lambda a, b: a == b,
        "ne": lambda a, b: a != b,
    }
    return found


def _quotient(a: float, b: float) -> float:
    """a / b as processors divide: by 0 it is infinite, or no number."""
    if b:
        return a / b
    return math.nan if a == 0 or a != a else math.copysign(math.inf, a) * math.copysign(1, b)
