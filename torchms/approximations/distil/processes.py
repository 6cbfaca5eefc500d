"""The processes of a distillation under torchrun."""

import os

import torch


def processes() -> tuple[int, int]:
    """This process's number and how many there are, as torchrun says."""
    return int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))


def threads_of(threads: int | None, world: int) -> int:
    """Threads of this process: `threads`, or its share of the cores."""
    return threads or max(1, (os.cpu_count() or 1) // world)


def wait_for_all(world: int) -> None:
    """Return when every process has come here."""
    if world > 1:
        torch.distributed.init_process_group("gloo")
        torch.distributed.barrier()
        torch.distributed.destroy_process_group()
