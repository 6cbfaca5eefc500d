"""A program as something to call: where its columns are, where its results go, over which rows and paths."""

import ctypes
from array import array
from typing import NamedTuple

from torchms.machine.build import built
from torchms.machine.program import Program
from torchms.machine.simplify import simplified
from torchms.machine.source import source

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


class Code:
    """The machine code of a program. exact: whether it rounds after every operation, as eager torch does."""

    def __init__(self, program: Program, exact: bool) -> None:
        program = simplified(program, fast=not exact)
        library = built(source(program, fast=not exact), exact)
        integer, pointer = ctypes.c_int64, ctypes.c_void_p
        library.n_cells.restype = integer
        self.n_cells = int(library.n_cells())
        self.n_results = len(program.results)
        self._prelude, self._run = library.prelude, library.run
        self._prelude.argtypes, self._prelude.restype = [pointer, pointer], None
        self._run.argtypes = [pointer, pointer, pointer, pointer, ctypes.c_double, *[integer] * 5, pointer]
        self._run.restype = None

    def prepared(self, columns: list[Column], shared: list[int]) -> "Call":
        """A call with these columns, and tensors that all elements share at the addresses `shared`."""
        where = array("q", shared or [0])
        cells = array("d", bytes(8 * max(self.n_cells, 1)))
        self._prelude(where.buffer_info()[0], cells.buffer_info()[0])
        return Call(self, array("q", [word for column in columns for word in column]), cells, where)


class Call:
    """Code with its inputs, ready to run over any part of the rows and paths."""

    def __init__(self, code: Code, columns: array, cells: array, shared: array) -> None:
        self.code, self.columns, self.cells, self.shared = code, columns, cells, shared

    def run(
        self, results: list[Result], scale: float, rows: tuple[int, int], paths: tuple[int, int], by_rows: bool
    ) -> array:
        """Compute these rows and paths, and give back the sums of the results that are a `TOTAL`."""
        where = array("q", [word for result in results for word in result])
        totals = array("d", bytes(8 * max(self.code.n_results, 1)))
        self.code._run(
            self.columns.buffer_info()[0],
            where.buffer_info()[0],
            self.cells.buffer_info()[0],
            self.shared.buffer_info()[0],
            scale,
            *rows,
            *paths,
            by_rows,
            totals.buffer_info()[0],
        )
        return totals
