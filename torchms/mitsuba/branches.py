"""Choices between two long computations become branches: which network of glass is asked, that of reflection or the other.

where(m, a, b) needs a where m holds and b elsewhere. Processors work on a packet of elements at once, and a packet none of
whose elements need one of the sides passes it by.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from torchms.machine.program import Program

LEAST = 200
"""Operations on either side that are worth a branch."""

Arguments = Callable[[int], tuple[int, ...]]


@dataclass(frozen=True)
class Branch:
    """results: choices by `mask`; yes and no: what to do for them on either side, and the values that they are there."""

    mask: int
    results: Sequence[int]
    yes: "Plan"
    no: "Plan"


@dataclass(frozen=True)
class Plan:
    """Operations and branches in order; then results[i] is the value of what was asked for. known: masks, and what they are."""

    steps: Sequence[int | Branch]
    results: Sequence[int]
    known: Mapping[int, bool]


class Planner:
    """Plans for a program whose operation v takes the values `arguments(v)`."""

    def __init__(self, program: Program, arguments: Arguments) -> None:
        self.program, self.arguments = program, arguments

    def plan(self, branches: bool) -> Plan:
        """Of the whole program; without branches it is its operations in order."""
        results = self.program.results
        return (
            self._plan(results, frozenset(), {})
            if branches
            else Plan(self._need(results, frozenset(), {}), results, {})
        )

    def _plan(self, asked: Iterable[int], there: frozenset[int], known: Mapping[int, bool]) -> Plan:
        """What gives the values `asked`, when the values `there` are there and some masks are known."""
        results = [self.final(v, known) for v in asked]
        need = self._need(results, there, known)
        mask, only = self._best(need, results, known)
        if mask is None:
            return Plan(need, results, known)
        rest = [v for v in need if v not in only]
        choices = [v for v in rest if self._chosen_by(v) == mask and only.keys() & set(self.arguments(v)[1:])]
        after = set(choices)
        for v in rest:
            if after.intersection(self._taken(v, known)):
                after.add(v)
        before = [v for v in rest if v not in after]
        sides = [
            self._plan([self.arguments(v)[side] for v in choices], there | set(before), {**known, mask: side == 1})
            for side in (1, 2)
        ]
        later = [v for v in rest if v in after and v not in choices]
        return Plan([*before, Branch(mask, choices, *sides), *later], results, known)

    def _chosen_by(self, v: int) -> int | None:
        return self.arguments(v)[0] if self.program.operations[v].name == "where" else None

    def final(self, v: int, known: Mapping[int, bool]) -> int:
        """What `v` is, with the choices made that are known."""
        while (mask := self._chosen_by(v)) is not None and mask in known:
            v = self.arguments(v)[1 if known[mask] else 2]
        return v

    def _taken(self, v: int, known: Mapping[int, bool]) -> list[int]:
        return [self.final(a, known) for a in self.arguments(v)]

    def _need(self, results: Sequence[int], there: frozenset[int], known: Mapping[int, bool]) -> list[int]:
        """The operations that `results` need, in order."""
        found: set[int] = set()
        open_ = [v for v in results if v not in there]
        while open_:
            v = open_.pop()
            if v not in found:
                found.add(v)
                open_ += [a for a in self._taken(v, known) if a not in there and a not in found]
        return sorted(found)

    def _best(
        self, need: list[int], results: Sequence[int], known: Mapping[int, bool]
    ) -> tuple[int | None, dict[int, bool]]:
        """The mask that saves most, and what only one of its sides needs; None if none is worth it."""
        most: tuple[int | None, dict[int, bool]] = (None, {})
        for mask in self._candidates(need, known):
            only = self._only(mask, need, results, known)
            work = [side for v, side in only.items() if self.program.operations[v].name not in ("number", "column")]
            if min(sum(work), len(work) - sum(work)) >= LEAST and len(only) > len(most[1]):
                most = mask, only
        return most

    def _candidates(self, need: list[int], known: Mapping[int, bool]) -> list[int]:
        """Masks of which either side takes many operations that the other does not."""
        place = {v: k for k, v in enumerate(need)}
        # Sets of operations as bits.
        under: dict[int, int] = {}
        sides: dict[int, list[int]] = {}
        for v in need:
            below = [under.get(a, 0) for a in self._taken(v, known)]
            under[v] = 1 << place[v]
            for bits in below:
                under[v] |= bits
            if (mask := self._chosen_by(v)) is not None:
                before = sides.get(mask, [0, 0])
                sides[mask] = [a | b for a, b in zip(before, below[1:], strict=True)]
        return [m for m, (a, b) in sides.items() if min((a & ~b).bit_count(), (b & ~a).bit_count()) >= LEAST]

    def _only(self, mask: int, need: list[int], results: Sequence[int], known: Mapping[int, bool]) -> dict[int, bool]:
        """What nothing needs but one side of the choices by `mask`, and whether that is the one where it holds."""
        # Sides that use a value: 1 where the mask holds, 2 elsewhere, 0 whatever it is.
        sides: dict[int, set[int]] = {v: set() for v in need}
        for v in (*results, mask):
            sides.get(v, set()).add(0)
        for v in reversed(need):
            side = next(iter(sides[v])) if len(sides[v]) == 1 else 0
            by = self._chosen_by(v) == mask
            for position, a in enumerate(self.arguments(v)):
                a = self.final(a, known)
                if a in sides:
                    sides[a].add(position if by and position else side)
        return {v: found == {1} for v, found in sides.items() if found in ({1}, {2})}
