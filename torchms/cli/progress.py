"""Progress bars on standard error, shown on a terminal only."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


@contextmanager
def progress_bar(
    title: str, total: int, shown: bool | None = None, *, unit: str | None = None
) -> Iterator[Callable[[int], None]]:
    """A function that advances a bar of `total` steps; `shown=None` shows it if standard error is a terminal.

    unit: what a step is called; the bar then shows millions of them a second instead of how many there were.
    """
    console = Console(stderr=True)
    disabled = not (console.is_terminal if shown is None else shown)
    told = MofNCompleteColumn() if unit is None else TextColumn("{task.fields[speed]}")
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), told, TimeRemainingColumn())
    begin, done = time.perf_counter(), 0
    with Progress(*columns, console=console, disable=disabled, transient=True) as bar:
        task = bar.add_task(title, total=total, speed="")

        def advance(steps: int) -> None:
            nonlocal done
            done += steps
            speed = done / max(time.perf_counter() - begin, 1e-9)
            bar.update(task, advance=steps, speed=f"{speed / 1e6:.2f} M {unit}/s")

        yield advance
