"""Products with matrices in memory, which are loops in machine code from a certain size on."""

from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor

from torchms.bsdfs import compile as compiled
from torchms.machine import operations
from torchms.machine.code import EACH, Code, Column, Result
from torchms.machine.program import Program
from torchms.machine.record import Recorder, record

ROWS = 21
SIZES = [(2, 70), (11, 12), (12, 11), (13, 12), (24, 6), (25, 36), (37, 5), (130, 2)]
"""Numbers of rows around the twelve that are summed together, and of columns."""


@pytest.fixture(autouse=True)
def _with_a_compiler() -> None:
    if compiled._missing_compiler():
        pytest.skip("torchms.compile needs a C++ compiler")


def programmed(
    function: Callable[[list[Tensor], list[Tensor]], Sequence[Tensor]], x: Tensor, shared: list[Tensor]
) -> Program:
    """The program of `function` of the elements' own numbers and of those that all share."""

    def recorded(recorder: Recorder) -> Sequence[Tensor]:
        return function([recorder.column(x.dtype) for _ in x], [recorder.shared(t) for t in shared])

    return record(recorded)[0]


def outputs(program: Program, x: Tensor, shared: list[Tensor]) -> Tensor:
    """What machine code says for the columns x (columns, elements): (results, elements)."""
    size, found = x.element_size(), torch.empty(len(program.results), x.shape[1], dtype=x.dtype)
    columns = [Column(column.data_ptr(), size, 0) for column in x]
    call = Code(program, exact=False).prepared(columns, [t.data_ptr() for t in shared])
    call.run([Result(result.data_ptr(), size, 0, EACH) for result in found], 1.0, (0, x.shape[1]), (0, 1), True)
    return found


def loops(program: Program) -> int:
    return sum(operation.name == "matrix" for operation in program.operations)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("own", [1, 3, 70])
def test_products_of_all_sizes(own, dtype, generator):
    """W x and xᵀ Wᵀ, W as it lies and turned, each a part of another; elements have `own` numbers of x, the rest they share."""
    whole = torch.randn(200, 90, generator=generator, dtype=dtype)
    x, rest = (torch.randn(*shape, generator=generator, dtype=dtype) for shape in ((own, ROWS), (70,)))

    def products(columns: list[Tensor], shared: list[Tensor]) -> list[Tensor]:
        found = []
        for rows, width in SIZES:
            mine = columns[:width]
            vector = torch.cat([*mine, shared[1][: width - len(mine)].expand(width - len(mine))])
            straight, turned = shared[0][3 : 3 + rows, 1 : 1 + width], shared[0][2 : 2 + width, :rows].mT
            found.append(straight @ vector[:, None])
            if rows <= 90:
                found.append(vector[None] @ turned.mT)
        return found

    program = programmed(products, x, [whole, rest])
    assert loops(program) >= len(SIZES)
    expected = [torch.cat([p.reshape(-1) for p in products(list(column[:, None]), [whole, rest])]) for column in x.T]
    torch.testing.assert_close(outputs(program, x, [whole, rest]), torch.stack(expected, 1), rtol=1e-5, atol=1e-5)


def test_small_ones_and_uneven_ones_are_written_out(generator):
    """A matrix of few numbers, and one that does not lie in even steps, are no loop, and right."""
    small, large = (torch.randn(*shape, generator=generator) for shape in ((4, 5), (40, 30)))
    assert small.numel() <= operations.UNROLLED < 20 * 30
    x, order = torch.randn(30, ROWS, generator=generator), torch.randperm(40, generator=generator)[:20]

    def products(columns: list[Tensor], shared: list[Tensor]) -> list[Tensor]:
        vector = torch.cat(columns)[:, None]
        return [shared[0] @ vector[:5], shared[1][order] @ vector]

    program = programmed(products, x, [small, large])
    assert loops(program) == 0
    expected = torch.cat([small @ x[:5], large[order] @ x])
    torch.testing.assert_close(outputs(program, x, [small, large]), expected, rtol=1e-5, atol=1e-5)


def test_columns_in_any_order(generator):
    """Rows are in even steps, columns where they are: still a loop."""
    matrix, order = torch.randn(20, 30, generator=generator), torch.randperm(30, generator=generator)[:20]
    x = torch.randn(20, ROWS, generator=generator)
    program = programmed(lambda columns, shared: [shared[0][:, order] @ torch.cat(columns)[:, None]], x, [matrix])
    assert loops(program) == 1
    torch.testing.assert_close(outputs(program, x, [matrix]), matrix[:, order] @ x, rtol=1e-5, atol=1e-5)


def test_gradient_through_a_network(generator):
    """The chain rule, whose matrices are turned, gives what autograd says."""
    weights = [torch.randn(*shape, generator=generator) / 4 for shape in ((26, 14), (18, 26), (1, 18))]
    x = torch.randn(14, ROWS, generator=generator)

    def gradient(columns: list[Tensor], shared: list[Tensor]) -> Sequence[Tensor]:
        first = torch.tanh(shared[0] @ torch.stack(columns))
        second = torch.tanh(shared[1] @ first)
        below = shared[1].mT @ ((1 - second.square()) * shared[2].mT)
        return [shared[0].mT @ (below * (1 - first.square()))]

    program = programmed(gradient, x, weights)
    assert loops(program) == 4
    leaf = x.clone().requires_grad_()
    torch.tanh(weights[1] @ torch.tanh(weights[0] @ leaf)).mul(weights[2].mT).sum().backward()
    torch.testing.assert_close(outputs(program, x, weights), leaf.grad, rtol=1e-4, atol=1e-5)
