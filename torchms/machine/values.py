"""Which values of a `Program` the elements of a tensor are."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchms.machine.program import KINDS, Number, Program

DTYPES = {kind: dtype for dtype, kind in KINDS.items()}


class Values:
    """The values that tensors stand for: an int64 tensor of the same shape, with an index into the program an element."""

    def __init__(self) -> None:
        self.program = Program()
        self.known: dict[int, Tensor] = {}
        self.unread: dict[int, int] = {}
        self.alive: list[Tensor] = []

    def note(self, tensor: Tensor, values: Tensor) -> Tensor:
        """Remember that `tensor` stands for `values`."""
        self.known[id(tensor)] = values
        # An id is that of one object only as long as the object lives.
        self.alive.append(tensor)
        return tensor

    def note_shared(self, tensor: Tensor, which: int) -> Tensor:
        """Remember that `tensor` holds the numbers of the shared tensor `which`; they become values when they are used."""
        self.unread[id(tensor)] = which
        self.alive.append(tensor)
        return tensor

    def knows(self, x: Tensor) -> bool:
        """Whether `x` stands for values, not for plain numbers."""
        return id(x) in self.known or id(x) in self.unread

    def of(self, x: Tensor | Number, dtype: torch.dtype | None = None) -> Tensor:
        """The values of a tensor or number, in `dtype` if it is given."""
        if not isinstance(x, Tensor):
            assert dtype is not None
            return torch.tensor(self.program.number(torch.tensor(x, dtype=dtype).item(), KINDS[dtype]))
        found = self.known.get(id(x))
        if found is None and id(x) in self.unread:
            which, kind = self.unread.pop(id(x)), KINDS[x.dtype]
            found = like([self.program.add("shared", kind, which, i) for i in range(x.numel())], x.shape)
            self.known[id(x)] = found
        if found is None:
            kind = KINDS[x.dtype]
            found = like([self.program.number(v, kind) for v in x.reshape(-1).tolist()], x.shape)
        return found if dtype is None else self.cast(found, dtype)

    def cast(self, values: Tensor, dtype: torch.dtype) -> Tensor:
        """The same numbers in another dtype."""
        return like([self._cast(v, KINDS[dtype]) for v in values.reshape(-1).tolist()], values.shape)

    def _cast(self, value: int, kind: str) -> int:
        if self.program.operations[value].kind == kind:
            return value
        number = self.program.constant(value)
        if number is not None:
            return self.program.number(torch.tensor(number).to(DTYPES[kind]).item(), kind)
        return self.program.add("cast", kind, value)

    def each(self, operation: str, kind: str, shape: Sequence[int], *operands: Tensor) -> Tensor:
        """An operation on every element of operands that broadcast to `shape`."""
        flat = [x.expand(tuple(shape)).reshape(-1).tolist() for x in operands]
        return like([self.program.add(operation, kind, *v) for v in zip(*flat, strict=True)], shape)


def like(values: list[int], shape: Sequence[int]) -> Tensor:
    """`values` as a tensor of that shape."""
    return torch.tensor(values, dtype=torch.int64).reshape(tuple(shape))
