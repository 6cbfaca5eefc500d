"""A small call whose shapes, strides and tensors are known: only addresses are missing, and one thread does it at once."""

from array import array
from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.evaluation.inputs import Inputs
from torchms.evaluation.numbers import Given, Streamed
from torchms.evaluation.program import Compiled
from torchms.evaluation.run import ALONG_PATHS, FEW, PATHS
from torchms.sampling.stream import Stream

COLUMN = RESULT = 4
"""Words of one in what machine code is given."""


class Plan:
    """Such a call: what machine code is given, with zeros where addresses will stand.

    views: tensors, each with its strides, and the words that are addresses within it, with their offsets.
    """

    def __init__(self, program: Compiled, inputs: Inputs, given: Sequence[Tensor], batch: torch.Size) -> None:
        self.program, self.code, self.batch = program, program.code, batch
        self.n, self.N, self.scale = inputs.n_rows, inputs.n_paths, program.scale(inputs.n_paths)
        self.by_rows = self.N < ALONG_PATHS
        columns, room = inputs.columns(), program.room(self.n, self.N)
        results = program.results(room, self.n)
        first_shared = COLUMN * len(columns) + RESULT * len(results)
        self.n_shared = sum(entry.role == "shared" for entry in inputs.inputs)
        words = [word for entry in (*columns, *results) for word in entry]
        self.words = array("q", [*words, *[0] * (self.n_shared + self.code.n_cells + 1)])
        checks = inputs.checks()
        self.checks, self.n_checks = array("d", [number for check in checks for number in check] or [0]), len(checks)
        self.views: list[tuple[Tensor | None, tuple[int, ...], list[tuple[int, int]]]] = []
        column, shared = len(inputs.counters), first_shared
        for i, (x, entry) in enumerate(zip(inputs.tensors, inputs.inputs, strict=True)):
            source = given[i] if i < len(given) else x
            if entry.role == "shared":
                places = [(shared, x.data_ptr() - source.data_ptr())]
                shared += 1
            else:
                count = x.shape[-1] if len(entry.columns) else 1
                own = range(column, column + count)
                places = [(COLUMN * c, columns[c].address - source.data_ptr()) for c in own]
                column += count
            self.views.append((None if i < len(given) else x, source.stride(), places))
        self.room: list[list[tuple[int, int]]] = []
        word = COLUMN * len(columns)
        for whole in room:
            here = [r for r in results if 0 <= r.address - whole.data_ptr() < whole.nbytes]
            self.room.append([(word + RESULT * k, r.address - whole.data_ptr()) for k, r in enumerate(here)])
            word += RESULT * len(here)
        # (*lead, [N], rows) → (rows, [N], *lead).
        self.orders = []
        for whole in room:
            lead = whole.ndim - 1 - int(program.kernel.per_path)
            self.orders.append((*range(whole.ndim - 1, lead - 1, -1), *range(lead)))
        self.counted = bool(inputs.counters)

    @staticmethod
    def of(program: Compiled, inputs: Inputs, given: Sequence[Tensor], batch: torch.Size) -> "Plan | None":
        """The plan of calls like this one, of which `given` are the directions; None if one would not be right or fast."""
        source = inputs.source
        if torch.is_grad_enabled() and any(x.requires_grad for x in inputs.tensors):
            return None
        if isinstance(source, Given):
            if not isinstance(source.given, Tensor):
                return None
            given = (*given, source.given)
        simple = isinstance(source, Given) or not isinstance(source, Streamed) or len(inputs.counters) == 2
        known = all(entry.role not in ("point", "seed") for entry in inputs.inputs)
        here = all(_within(x, source) for x, source in zip(inputs.tensors, given, strict=False))
        whole = all(
            x.is_contiguous() for x, entry in zip(inputs.tensors, inputs.inputs, strict=True) if entry.role == "shared"
        )
        few = inputs.n_rows * inputs.n_paths * program.code.n_operations <= FEW and inputs.n_paths <= PATHS
        return Plan(program, inputs, given, batch) if simple and known and here and whole and few else None

    def run(
        self, given: Sequence[Tensor], u: Tensor | Stream | None, checked: bool
    ) -> tuple[tuple[Tensor, ...], bool] | None:
        """The values, and whether a check failed; None if the call is not of this plan."""
        words = self.words[:]
        given = (*given, u) if isinstance(u, Tensor) else given
        differentiable = torch.is_grad_enabled()
        for i, (x, stride, places) in enumerate(self.views):
            source = given[i] if x is None else x
            if source.stride() != stride or (differentiable and source.requires_grad):
                return None
            start = source.data_ptr()
            for word, offset in places:
                words[word] = start + offset
        if self.counted:
            assert isinstance(u, Stream) and isinstance(u.seed, int)
            words[2 * COLUMN - 1] = u.seed << 32
        room = self.program.room(self.n, self.N)
        for whole, places in zip(room, self.room, strict=True):
            start = whole.data_ptr()
            for word, offset in places:
                words[word] = start + offset
        bad = self.code.at_once(
            words.buffer_info()[0],
            self.n_shared,
            self.checks.buffer_info()[0],
            self.n_checks if checked else 0,
            self.scale,
            self.n,
            self.N,
            self.by_rows,
        )
        found = tuple(whole.permute(order) for whole, order in zip(room, self.orders, strict=True))
        if len(self.batch) != 1:
            found = tuple(out.reshape((*self.batch, *out.shape[1:])) for out in found)
        return found, bool(bad)


def _within(x: Tensor, source: Tensor) -> bool:
    """Whether `x` is a view of `source`."""
    return x.untyped_storage().data_ptr() == source.untyped_storage().data_ptr()
