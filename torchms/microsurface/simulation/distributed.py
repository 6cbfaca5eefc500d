"""One simulation on many processes under torch.distributed (gloo), with the same bits for any number of them.

Each process traces a run of whole shards; all sums are of whole numbers, so their order does not matter. `simulate`
does this by itself once a process group is up, e.g. `torchrun --nproc-per-node=2 -m torchms simulate ...`.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist

from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Shard

# A slow worker is no error: the others wait for it. torchrun itself ends the group when a process dies.
PATIENCE = timedelta(days=30)


@contextmanager
def process_group() -> Iterator[None]:
    """A gloo process group if torchrun started this process, else nothing."""
    if "WORLD_SIZE" not in os.environ or dist.is_initialized():
        yield
        return
    dist.init_process_group("gloo", timeout=PATIENCE)
    try:
        yield
    finally:
        dist.destroy_process_group()


def rank_and_size() -> tuple[int, int]:
    """This process's number and how many there are: (0, 1) without a process group."""
    if dist.is_available() and dist.is_initialized():
        return dist.get_rank(), dist.get_world_size()
    return 0, 1


def local_size() -> int:
    """Processes of the group on this machine."""
    return int(os.environ.get("LOCAL_WORLD_SIZE", "1")) if rank_and_size()[1] > 1 else 1


def share_of(todo: Sequence[Shard]) -> list[Shard]:
    """This process's run of `todo`; neighbours share a surface, so few surfaces are built twice."""
    rank, size = rank_and_size()
    return list(todo[len(todo) * rank // size : len(todo) * (rank + 1) // size])


def owners(readable: Sequence[bool]) -> list[int]:
    """For each shard, the lowest rank that has it in its checkpoint directory, or −1 if none has.

    Machines need not share a file system.
    """
    rank, size = rank_and_size()
    owner = torch.tensor([rank if has else size for has in readable], dtype=torch.int64)
    if size > 1:
        dist.all_reduce(owner, dist.ReduceOp.MIN)
    return [-1 if r == size else r for r in owner.tolist()]


def add_up(total: Partial) -> None:
    """Sum `total` over all processes, in place and on each of them."""
    if rank_and_size()[1] == 1:
        return
    # The measured slopes of a surface come from every worker that traced on it, all alike: the largest is any of them.
    for name, array in total.arrays().items():
        dist.all_reduce(torch.from_numpy(array), dist.ReduceOp.MAX if name == "measured" else dist.ReduceOp.SUM)


def slowest_and_sum(slowest: Sequence[float], summed: Sequence[int]) -> tuple[list[float], list[float]]:
    """Maximum of the first numbers and sum of the others over all processes."""
    a, b = (torch.tensor(list(v), dtype=torch.float64) for v in (slowest, summed))
    if rank_and_size()[1] > 1:
        dist.all_reduce(a, dist.ReduceOp.MAX)
        dist.all_reduce(b, dist.ReduceOp.SUM)
    return a.tolist(), b.tolist()


def wait_for_all() -> None:
    """Return when every process has come here."""
    if rank_and_size()[1] > 1:
        dist.barrier()
