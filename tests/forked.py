"""A process that starts at once: a copy of this one, which does one thing and ends."""

import os
import signal
import sys
import time
from collections.abc import Callable

INTERRUPT = {signal.SIGINT}
LONGEST = 300.0
"""Seconds that a process may take if nobody says otherwise: one that hangs is a failure, not a suite without an end."""


class Forked:
    """Runs `work` in a copy of this process; its code is 0, what `work` returned, or 1 if it raised.

    An interrupt reaches `work` and nothing else: the copy never returns to its caller.
    """

    def __init__(self, work: Callable[[], object]) -> None:
        self.code: int | None = None
        before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPT)
        self.pid = os.fork()
        if self.pid:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            return
        code = 1
        # Two levels: an interrupt may still come in the inner `finally`, and none after it.
        try:
            try:
                with open(os.devnull, "w") as null:
                    sys.stdout = sys.stderr = null
                    signal.pthread_sigmask(signal.SIG_UNBLOCK, INTERRUPT)
                    found = work()
                    code = found if isinstance(found, int) else 0
            finally:
                signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPT)
        finally:
            os._exit(code)

    def poll(self) -> int | None:
        """The exit code (negative: the signal), or None while it runs."""
        if self.code is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if ended else None
        return self.code

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, when it has ended; AssertionError, and its end, if that takes longer than `timeout` seconds."""
        timeout = LONGEST if timeout is None else timeout
        until = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > until:
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
                raise AssertionError(f"a forked process did not end in {timeout} s")
            time.sleep(0.002)
        return code
