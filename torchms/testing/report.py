"""What a suite of laws found: one line a law, and which of them failed."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple


class Law(NamedTuple):
    """One law on one object: `figure` was measured, `bound` is what it must keep.

    is_chance: the figure is a p-value, which must not be less than the bound; else it is an error, which must not be more.
    note: where the figure comes from, or the message of the error that was raised instead.
    """

    name: str
    figure: float
    bound: float
    is_chance: bool = False
    note: str = ""

    @property
    def passed(self) -> bool:
        """Whether the law holds; a figure that is NaN does not."""
        return self.figure >= self.bound if self.is_chance else self.figure <= self.bound


@dataclass(frozen=True)
class Report:
    """All laws that applied to `subject`; prints as a table."""

    subject: str
    laws: tuple[Law, ...]

    @property
    def failed(self) -> tuple[Law, ...]:
        """The laws that do not hold; empty if all is well."""
        return tuple(law for law in self.laws if not law.passed)

    def __iter__(self) -> Iterator[Law]:
        return iter(self.laws)

    def __str__(self) -> str:
        width = max((len(law.name) for law in self.laws), default=0)
        lines = [f"{self.subject}: {len(self.laws) - len(self.failed)} of {len(self.laws)} laws hold"]
        for law in self.laws:
            verdict = "ok    " if law.passed else "FAILED"
            relation = "p =" if law.is_chance else "off"
            figure = f"{relation} {law.figure:9.2e}, {'least' if law.is_chance else 'most '} {law.bound:.1e}"
            lines.append(f"  {verdict} {law.name:{width}}  {figure}  {law.note}".rstrip())
        return "\n".join(lines)


class Check(NamedTuple):
    """A law that is still to be tried: `measure` gives its figure, or the figure and a note.

    bound: most that an error may be; None for a p-value, whose level depends on how many there are.
    """

    name: str
    measure: Callable[[], float | tuple[float, str]]
    bound: float | None = None


def tried(check: Check, level: float) -> Law:
    """The law's outcome; one that raises has failed, with the message as its note."""
    is_chance = check.bound is None
    bound = level if check.bound is None else check.bound
    try:
        found = check.measure()
    except Exception as error:  # a law is what must tell, whatever the object does
        return Law(
            check.name, math.nan, bound, is_chance, f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
        )
    figure, note = found if isinstance(found, tuple) else (found, "")
    return Law(check.name, figure, bound, is_chance, note)


def chances(checks: Iterable[Check]) -> int:
    """How many of the checks are p-values, which share one level."""
    return sum(check.bound is None for check in checks)
