"""Watches a function of tensors run on one element, and writes its operations into a `Program`.

What only moves numbers about (views, stacks) moves the indices of values, the rest is done element by element. The
function sees tensors of one row, so what it does must not depend on their values: what compiles and exports.
"""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor
from torch._decomp import decomposition_table
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

from torchms.machine.operations import computed, knows
from torchms.machine.program import KINDS, Program
from torchms.machine.values import Values


class UnknownOperation(NotImplementedError):
    """An operation that no machine code is written for."""


MOVES = frozenset(
    (
        *(
            "alias",
            "as_strided",
            "cat",
            "clone",
            "contiguous",
            "detach",
            "diagonal",
            "expand",
            "flip",
            "index",
            "index_select",
        ),
        *(
            "lift_fresh",
            "movedim",
            "permute",
            "repeat",
            "roll",
            "select",
            "slice",
            "split",
            "split_with_sizes",
            "squeeze",
        ),
        *("stack", "t", "transpose", "unbind", "unfold", "unsqueeze", "view", "_unsafe_view", "_reshape_alias"),
    )
)
"""What only moves numbers about."""
PICKS = frozenset(("index", "index_select"))
"""Those whose further tensors are no values, but say which are taken."""
NEW = frozenset(
    ["zeros_like", "ones_like", "full_like", "new_zeros", "new_ones", "new_full", "empty_like", "new_empty"]
)
"""What takes no number from its tensor."""


class Recorder(TorchDispatchMode):
    """While it is entered, operations on the tensors that `column` and `shared` gave are written into a program.

    holds: whether `detach` is an operation of the program, for who differentiates that, or only another name of a number.
    """

    one_element = True
    """For `torchms.maths.numerics.is_recorded`."""

    def __init__(self, holds: bool = False) -> None:
        super().__init__()
        self.holds = holds
        self.values = Values()
        self.n_columns = self.n_shared = 0

    @property
    def program(self) -> Program:
        return self.values.program

    def column(self, dtype: torch.dtype) -> Tensor:
        """A number (1) that every element has for itself."""
        value = self.program.add("column", KINDS[dtype], self.n_columns)
        self.n_columns += 1
        # Any number will do: what is recorded does not depend on it.
        return self.values.note(torch.full((1,), 0.5).to(dtype), torch.tensor([value]))

    def shared(self, tensor: Tensor) -> Tensor:
        """A copy of `tensor`, whose numbers all elements share."""
        which, self.n_shared = self.n_shared, self.n_shared + 1
        return self.values.note_shared(tensor.detach().clone(), which)

    def result(self, tensor: Tensor) -> None:
        """Make the elements of `tensor`, in order, results."""
        self.program.results += self.values.of(tensor).reshape(-1).tolist()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        name = func.overloadpacket.__name__
        tensors = (a for a in tree_leaves((args, kwargs)) if isinstance(a, Tensor))
        if name in NEW or not any(self.values.knows(a) for a in tensors):
            return func(*args, **kwargs)
        in_place = name.endswith("_") and not name.endswith("__")
        plain = name.removesuffix("_") if in_place else name
        if plain == "detach" and self.holds:
            out = func(*args, **kwargs)
            return self.values.note(
                out, self.values.each("detach", KINDS[out.dtype], out.shape, self.values.of(args[0]))
            )
        if plain not in MOVES and not knows(plain):
            return self._decomposed(func, args, kwargs)
        out = func(*args, **kwargs)
        if plain not in MOVES:
            try:
                return self.values.note(out, computed(self.values, plain, out, args, kwargs))
            except NotImplementedError as error:
                raise UnknownOperation(str(error)) from error
        if name in PICKS and any(self.values.knows(a) for a in tree_leaves(args[1:]) if isinstance(a, Tensor)):
            raise UnknownOperation(f"{func} with indices that depend on the numbers")
        indices = (self.values.of(args[0]), *args[1:]) if name in PICKS else tree_map(self._indices, args)
        moved = func(*indices, **kwargs)
        for one, values in zip(_several(out), _several(moved), strict=True):
            self.values.note(one, self.values.cast(values, one.dtype))
        return out

    def _decomposed(self, func: Any, args: Any, kwargs: Any) -> Any:
        decomposition = decomposition_table.get(func)
        with self:
            # What decompositions call may be made of other operations itself, as `to` is.
            found = func.decompose(*args, **kwargs) if decomposition is None else decomposition(*args, **kwargs)
        if found is NotImplemented:
            raise UnknownOperation(str(func))
        return found

    def _indices(self, x: Any) -> Any:
        return self.values.of(x) if isinstance(x, Tensor) else x


def _several(x: Any) -> Sequence[Tensor]:
    return x if isinstance(x, list | tuple) else (x,)


def record(function: Callable[[Recorder], Sequence[Tensor]], holds: bool = False) -> tuple[Program, list[torch.Size]]:
    """The program of `function`, which takes its inputs from the recorder, and the shapes of what it returns.

    holds: as for a `Recorder`.
    """
    recorder = Recorder(holds)
    with recorder:
        found = function(recorder)
    for tensor in found:
        recorder.result(tensor)
    return recorder.program, [x.shape for x in found]
