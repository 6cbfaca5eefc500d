"""A process that starts at once: a copy of this one, which does one thing and ends."""

import os
import sys
from collections.abc import Callable


class Forked:
    """Runs `work` in a copy of this process; its code is 0, what `work` returned, or 1 if it raised."""

    def __init__(self, work: Callable[[], object]) -> None:
        self.code: int | None = None
        self.pid = os.fork()
        if self.pid:
            return
        code = 1
        try:
            with open(os.devnull, "w") as null:
                sys.stdout = sys.stderr = null
                found = work()
            code = found if isinstance(found, int) else 0
        finally:
            os._exit(code)

    def poll(self) -> int | None:
        """The exit code (negative: the signal), or None while it runs."""
        return self._ended(os.WNOHANG)

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, when it has ended."""
        code = self._ended(0)
        assert code is not None
        return code

    def _ended(self, how: int) -> int | None:
        if self.code is None:
            ended, status = os.waitpid(self.pid, how)
            self.code = os.waitstatus_to_exitcode(status) if ended else None
        return self.code
