"""Threads for long work that an interrupt ends at once, not after what they are at."""

import ctypes
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import get_ident
from types import TracebackType
from typing import Any, TypeVar

A = TypeVar("A")
B = TypeVar("B")

AGAIN = 0.05
"""Seconds after which a worker that goes on is told once more: an exception that is raised in a finaliser is lost."""


class Stopped(BaseException):
    """Raised in a worker, wherever it is, when nobody wants its result any more."""


class Workers:
    """`n` threads; leaving the block by an exception, Ctrl-C in the first place, stops what they are at.

    Python delivers an interrupt to the main thread only, and a pool's end waits for its threads: a picture would go on for
    as long as its largest block takes. Here the same exception is raised in the workers, between two of their operations.
    """

    def __init__(self, n: int) -> None:
        self._pool = ThreadPoolExecutor(n)
        # No lock: what is interrupted while it holds one would hold it for ever. Both operations are atomic.
        self._busy: set[int] = set()
        self._stopped = False

    def __enter__(self) -> "Workers":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._stopped = True
            self._pool.shutdown(wait=False, cancel_futures=True)
            while self._busy:
                for thread in list(self._busy):
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(Stopped))
                time.sleep(AGAIN)
        self._pool.shutdown(wait=True)

    def submit(self, work: Callable[..., B], *arguments: Any) -> "Future[B]":
        """The result of `work(*arguments)`, which begins as soon as a thread is free."""
        return self._pool.submit(self._run, work, *arguments)

    def map(self, work: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
        """`work(item)` of all items, in their order; all are begun without waiting for who asks."""
        for future in [self.submit(work, item) for item in items]:
            yield future.result()

    def _run(self, work: Callable[..., B], *arguments: Any) -> B:
        thread = get_ident()
        self._busy.add(thread)
        try:
            if self._stopped:
                raise Stopped
            return work(*arguments)
        finally:
            self._busy.discard(thread)
