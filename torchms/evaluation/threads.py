"""Parts of a call side by side, each in a thread of its own that computes alone.

torch shares out a single operation among threads, with a barrier after each: on blocks that fit a cache that costs more
than it gives, and a thread that another program holds up makes all the others wait. Whole parts have no barriers.
"""

import itertools
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import torch
from torch._C._autograd import _saved_tensors_hooks_get_disabled_error_message, _top_saved_tensors_default_hooks
from torch._C._functorch import peek_interpreter_stack
from torch.autograd import forward_ad

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_size = 0
_here = threading.local()


def _forget() -> None:
    """In a process that was forked off, the threads of its parent are none of its own."""
    global _pool, _size, _lock
    _pool, _size, _lock = None, 0, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _alone() -> None:
    """Makes a worker's operations run in its own thread only."""
    _here.works = True
    # A thread takes up the number of the process at its first question; only then is it its own to change.
    torch.get_num_threads()
    torch.set_num_threads(1)


def _workers(n: int) -> ThreadPoolExecutor:
    """At least `n` workers, which are started once."""
    global _pool, _size
    with _lock:
        if _pool is None or _size < n:
            before = torch.get_num_threads()
            ready = threading.Barrier(n + 1)
            pool = ThreadPoolExecutor(n, "torchms", _alone)
            started = [pool.submit(ready.wait) for _ in range(n)]
            ready.wait()
            wait(started)
            # What new threads begin with is a number of the process, which each worker has set to one.
            torch.set_num_threads(before)
            if _pool is not None:
                _pool.shutdown(wait=False)
            _pool, _size = pool, n
        return _pool


def n_threads() -> int:
    """How many parts may be computed at a time: `torch.get_num_threads()`, and one within a part."""
    return 1 if getattr(_here, "works", False) else torch.get_num_threads()


def bound_to_this_thread() -> bool:
    """Whether something is in force, in this thread, that other threads would not know of: a transform, a mode, a hook."""
    return (
        peek_interpreter_stack() is not None
        or torch._C._len_torch_dispatch_stack() > 0
        or torch._C._len_torch_function_stack() > 0
        or forward_ad._current_level >= 0
        or _saved_tensors_hooks_get_disabled_error_message() is not None
        or _top_saved_tensors_default_hooks(True) is not None
    )


def share(n: int, work: Callable[[int], None], threads: int, *, join: bool = True) -> None:
    """`work(i)` for i = 0 … n − 1, in `threads` workers; the grad mode is that of the caller.

    join: whether the calling thread works too, which it may if what it does opens no threads of torch. The first exception
    is raised again when no part runs any more; parts that had not begun are left out then.
    """
    grad, inference = torch.is_grad_enabled(), torch.is_inference_mode_enabled()
    numbers = itertools.count()
    failed: list[tuple[int, BaseException]] = []
    stopped = False

    def take() -> None:
        with torch.inference_mode(inference), torch.set_grad_enabled(grad):
            while not stopped and not failed and (i := next(numbers)) < n:
                try:
                    work(i)
                except BaseException as error:
                    failed.append((i, error))

    pool = _workers(threads)
    tasks = [pool.submit(take) for _ in range(min(n, threads) - int(join))]
    try:
        if join:
            take()
        wait(tasks)
    finally:
        # After an interrupt, too, nobody may write into results that are given up.
        stopped = True
        wait(tasks)
    if failed:
        raise min(failed, key=lambda pair: pair[0])[1]
