"""One call of machine code over all rows and paths, cut among threads."""

from array import array
from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.evaluation import threads
from torchms.evaluation.inputs import Inputs
from torchms.machine.code import MEAN, TOTAL, Code, Column, Result

PIECE = 512
"""Elements that stay in the first cache: machine code takes rows by so many."""
ELEMENTS = 16384
"""Elements that a thread takes at a time."""
FEW = 16_000_000
"""Operations on single numbers that one thread does alone: another one would take longer to begin."""
ALONG_PATHS = 64
"""Paths from which on machine code goes along them, not along the rows."""
PATHS = 1 << 16
"""Paths of a row that a thread takes at a time."""


class Run:
    """One call of machine code over all rows and paths, cut among threads; `alive` is what results point into."""

    def __init__(
        self,
        code: Code,
        inputs: Inputs,
        columns: list[Column],
        results: list[Result],
        scale: float,
        alive: Sequence[Tensor],
    ) -> None:
        self.n, self.N = inputs.n_rows, inputs.n_paths
        self.results, self.scale, self.alive = results, scale, alive
        self.shared = inputs.shared()
        checks = () if inputs.look is None else inputs.checks()
        self.call = code.prepared(columns, [x.data_ptr() for x in self.shared], checks)
        self.by_rows = self.N < ALONG_PATHS
        self.sums = any(result.how == TOTAL for result in results)

    def whole(self) -> list[float]:
        """Run it; the totals of the results that are one."""
        groups = 1 if self.by_rows else -(-self.N // PATHS)
        n = threads.n_threads()
        if groups == 1 and not self.sums and (n == 1 or self.n * self.N * self.call.code.n_operations <= FEW):
            return list(self.call.run(self.results, self.scale, (0, self.n), (0, self.N), self.by_rows))
        return self._cut(groups, n)

    def _cut(self, groups: int, n: int) -> list[float]:
        """In parts whose sums are added up in one order, whatever thread took them."""
        step = max(1, min(ELEMENTS // min(self.N, PATHS), -(-self.n // 2)))
        step = -(-step // PIECE) * PIECE if self.by_rows else step
        length = -(-self.N // groups)
        jobs = [
            (first, min(first + step, self.n), g * length, min((g + 1) * length, self.N), g)
            for first in range(0, self.n, step)
            for g in range(groups)
        ]
        # The sums over further groups of paths stand aside until all of them are there.
        aside = [[torch.empty_like(x) for x in self.alive] for _ in range(groups - 1)]
        partial = [self.results, *(self._moved(tensors) for tensors in aside)]
        totals: list[array | None] = [None] * len(jobs)

        def run(i: int) -> None:
            row, row_end, path, path_end, group = jobs[i]
            totals[i] = self.call.run(partial[group], self.scale, (row, row_end), (path, path_end), self.by_rows)

        if n == 1 or len(jobs) == 1:
            for i in range(len(jobs)):
                run(i)
        else:
            threads.share(len(jobs), run, n)
        for tensors in aside if any(result.how == MEAN for result in self.results) else ():
            for whole, part in zip(self.alive, tensors, strict=True):
                whole += part
        if not self.sums:
            return []
        return torch.tensor([list(part) for part in totals if part is not None], dtype=torch.float64).sum(0).tolist()

    def _moved(self, tensors: Sequence[Tensor]) -> list[Result]:
        """The results in these tensors; those of each path stay where they are."""

        def moved(result: Result) -> Result:
            for whole, other in zip(self.alive, tensors, strict=True):
                offset = result.address - whole.data_ptr()
                if result.how == MEAN and 0 <= offset < whole.numel() * whole.element_size():
                    return result._replace(address=other.data_ptr() + offset)
            return result

        return [moved(result) for result in self.results]
