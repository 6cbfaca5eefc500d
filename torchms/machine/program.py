"""A program: what happens to the numbers of one element (row × path), as operations on single numbers.

Each operation is remembered once, however often it is asked for, and what depends on no input is computed at once.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch

KINDS = {torch.float32: "f", torch.float64: "d", torch.int32: "i", torch.int64: "l", torch.bool: "b"}
"""Letter of each dtype that machine code knows."""

Number = float | int | bool


class Operation(NamedTuple):
    """One operation: its name, the letter of its result, and what it takes: values before it, or plain numbers."""

    name: str
    kind: str
    arguments: tuple[int | Number | str, ...]


class Grid(NamedTuple):
    """A matrix in memory: a shared tensor, how far it is from one row to the next, how many there are, and the first one."""

    tensor: int
    down: int
    rows: int
    first: tuple[int, ...]


@dataclass
class Program:
    """Operations in order, of which some are results.

    Value i is what `operations[i]` gives. An element's own inputs are ("column", kind, (index,)), those that all elements
    share ("shared", kind, (tensor, offset)). An ("array", kind, values) is for ("matrix", kind, (array, tensor, down, rows,
    *first)), its product with the matrix of a `Grid`, whose elements are ("element", kind, (matrix, index)).
    `varies[i]`: whether value i may differ between elements.
    """

    operations: list[Operation] = field(default_factory=list)
    varies: list[bool] = field(default_factory=list)
    known: dict[Operation, int] = field(default_factory=dict)
    results: list[int] = field(default_factory=list)

    def add(self, name: str, kind: str, *arguments: int | Number | str) -> int:
        """The value of an operation on values, not of plain numbers."""
        operation = Operation(name, kind, arguments)
        found = self.known.get(operation)
        if found is None:
            found = self.known[operation] = len(self.operations)
            self.operations.append(operation)
            self.varies.append(name == "column" or any(self.varies[a] for a in self.taken(operation)))
        return found

    def number(self, value: Number, kind: str) -> int:
        """A plain number as a value."""
        # By its text: 0.0 and -0.0, and 1 and True, are equal.
        return self.add("number", kind, repr(value))

    @staticmethod
    def taken(operation: Operation) -> tuple[int, ...]:
        """The values that an operation takes."""
        if operation.name in LEAVES:
            return ()
        first_only = operation.name in ("matrix", "element")
        return operation.arguments[:1] if first_only else operation.arguments  # type: ignore[return-value]

    def grid(self, rows: list[list[int]]) -> Grid | None:
        """Where these values lie, if in one shared tensor with the same step from each row to the next; else None."""
        found = [[self.operations[v] for v in row] for row in rows]
        if len(rows) < 2 or any(o.name != "shared" for row in found for o in row):
            return None
        places = [[int(o.arguments[1]) for o in row] for row in found]
        tensor, down = found[0][0].arguments[0], places[1][0] - places[0][0]
        even = [[(tensor, place + k * down) for place in places[0]] for k in range(len(rows))]
        same = [[o.arguments for o in row] for row in found] == even
        return Grid(int(tensor), down, len(rows), tuple(places[0])) if same else None

    def constant(self, value: int) -> Number | None:
        """The plain number that a value is, if it is one."""
        operation = self.operations[value]
        if operation.name != "number":
            return None
        text = str(operation.arguments[0])
        return text == "True" if operation.kind == "b" else int(text) if operation.kind in "il" else float(text)

    def needed(self) -> list[bool]:
        """Whether each value is needed for the results."""
        found = [False] * len(self.operations)
        for value in self.results:
            found[value] = True
        for value in range(len(self.operations) - 1, -1, -1):
            if found[value]:
                for argument in self.taken(self.operations[value]):
                    found[argument] = True
        return found


LEAVES = frozenset(("column", "shared", "number"))
