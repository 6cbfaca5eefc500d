"""Progress bar of a simulation: share done, rays per second, time left."""

import sys
import time
from types import TracebackType
from typing import Any


class Progress:
    """A rich progress bar on standard error, silent if not `enabled` or if standard error is not a terminal."""

    def __init__(self, rays: int, enabled: bool) -> None:
        self.rays = rays
        self.done = 0
        self.begin = time.perf_counter()
        self.bar: Any = None
        self.task: Any = None
        if enabled and sys.stderr.isatty():
            try:
                import rich.console
                import rich.progress as rp
            except ImportError:
                return
            columns = (rp.TextColumn("microsurface"), rp.BarColumn(), rp.TaskProgressColumn())
            columns += (rp.TextColumn("{task.fields[speed]}"), rp.TimeRemainingColumn())
            self.bar = rp.Progress(*columns, console=rich.console.Console(stderr=True))
            self.task = self.bar.add_task("", total=rays, speed="")

    def advance(self, rays: int) -> None:
        """`rays` more rays are done."""
        self.done += rays
        if self.bar is not None:
            speed = self.done / max(time.perf_counter() - self.begin, 1e-9)
            self.bar.update(self.task, advance=rays, speed=f"{speed / 1e6:.2f} M rays/s")

    def __enter__(self) -> "Progress":
        if self.bar is not None:
            self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.bar is not None:
            self.bar.stop()
