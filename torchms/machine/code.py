"""A program as something to call: where its columns are, where its results go, over which rows and paths."""

import ctypes
from array import array
from collections.abc import Sequence
from typing import NamedTuple

from torchms.machine.build import built
from torchms.machine.program import Program
from torchms.machine.simplify import simplified
from torchms.machine.source import source

UNIT, COLUMN, FLOATS, DOUBLES = 0, 1, 2, 3
"""What a `Check` looks at."""
EACH, MEAN, TOTAL = 0, 1, 2
"""What happens to a result: one a path, `scale` × the sum over the paths, or the sum over all elements (in double)."""


class Column(NamedTuple):
    """Where an input of element (row, path) is: at address + row · row_step + path · path_step, in bytes.

    An address of 0 is a counter: the number base + row · row_step + path · path_step itself.
    """

    address: int
    row_step: int
    path_step: int
    base: int = 0


class Result(NamedTuple):
    """Where a result of element (row, path) goes, as for a `Column`, and what happens to it on the way."""

    address: int
    row_step: int
    path_step: int
    how: int


class Check(NamedTuple):
    """That numbers lie in [low, high], and are not NaN.

    what: `UNIT` for the squared length of the vector in columns first … first + 2, `COLUMN` for a column, `FLOATS` or `DOUBLES`
    for `size` numbers of the shared tensor `first`.
    """

    what: int
    first: int
    size: int
    low: float
    high: float


class Code:
    """The machine code of a program. exact: whether it rounds after every operation, as eager torch does."""

    def __init__(self, program: Program, exact: bool) -> None:
        program = simplified(program, fast=not exact)
        library = built(source(program, fast=not exact), exact)
        integer, pointer = ctypes.c_int64, ctypes.c_void_p
        library.n_cells.restype = integer
        self.n_cells = int(library.n_cells())
        self.n_results = len(program.results)
        self.n_operations = sum(program.varies)
        self.prelude, self.stray = library.prelude, library.shared_stray
        self.prelude.argtypes, self.prelude.restype = [pointer, pointer], None
        self.stray.argtypes, self.stray.restype = [pointer, pointer, integer], integer
        self.run, self.at_once = library.run, library.at_once
        self.run.argtypes = [*[pointer] * 5, integer, ctypes.c_double, *[integer] * 5, pointer]
        self.at_once.argtypes = [pointer, integer, pointer, integer, ctypes.c_double, *[integer] * 3]
        self.run.restype = self.at_once.restype = integer

    def prepared(self, columns: list[Column], shared: list[int], checks: Sequence[Check] = ()) -> "Call":
        """A call with these columns, and tensors that all elements share at the addresses `shared`."""
        return Call(self, array("q", [word for column in columns for word in column]), shared, checks)


class Call:
    """Code with its inputs, ready to run over any part of the rows and paths. bad: whether a check failed so far."""

    def __init__(self, code: Code, columns: array, shared: list[int], checks: Sequence[Check]) -> None:
        self.code, self.columns = code, columns
        self.shared = array("q", shared or [0])
        self.cells = array("d", bytes(8 * max(code.n_cells, 1)))
        self.checks, self.n_checks = array("d", [number for check in checks for number in check] or [0]), len(checks)
        where = self.shared.buffer_info()[0]
        code.prelude(where, self.cells.buffer_info()[0])
        self.bad = bool(code.stray(where, self.checks.buffer_info()[0], self.n_checks))

    def run(
        self, results: list[Result], scale: float, rows: tuple[int, int], paths: tuple[int, int], by_rows: bool
    ) -> array:
        """Compute these rows and paths, and give back the sums of the results that are a `TOTAL`."""
        where = array("q", [word for result in results for word in result])
        totals = array("d", bytes(8 * max(self.code.n_results, 1)))
        bad = self.code.run(
            self.columns.buffer_info()[0],
            where.buffer_info()[0],
            self.cells.buffer_info()[0],
            self.shared.buffer_info()[0],
            self.checks.buffer_info()[0],
            self.n_checks,
            scale,
            *rows,
            *paths,
            by_rows,
            totals.buffer_info()[0],
        )
        if bad:
            self.bad = True
        return totals
