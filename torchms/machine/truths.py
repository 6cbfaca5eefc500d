"""What masks say of each other: of one that is known, and of others over the same numbers."""

from torchms.machine.program import Operation, Program

Literals = frozenset[tuple[int, bool]]
"""Masks, and what they are."""

IMPLIED = {
    "gt": {"ge": True, "lt": False, "le": False, "eq": False, "ne": True},
    "lt": {"le": True, "gt": False, "ge": False, "eq": False, "ne": True},
    "ge": {"lt": False},
    "le": {"gt": False},
    "eq": {"ge": True, "le": True, "lt": False, "gt": False, "ne": False},
}
"""Comparisons of two numbers by one of them that is true; one that is false may have been of NaN, and says nothing."""


def implied(program: Program, mask: int, is_true: bool) -> Literals:
    """What is known if a mask is so."""
    found = {(mask, is_true)}
    name, _, arguments = program.operations[mask]
    if name == ("and" if is_true else "or"):
        for argument in arguments:
            found |= implied(program, int(argument), is_true)
    if name == "not":
        found |= implied(program, int(arguments[0]), not is_true)
    for other, other_true in IMPLIED.get(name, {}).items() if is_true else ():
        known = program.known.get(Operation(other, "b", arguments))
        if known is not None:
            found.add((known, other_true))
    return frozenset(found)


def truth(program: Program, mask: int, known: Literals) -> bool | None:
    """Whether a mask is true by what is known; None if that does not say."""
    if (mask, True) in known:
        return True
    if (mask, False) in known:
        return False
    name, _, arguments = program.operations[mask]
    if name == "not":
        below = truth(program, int(arguments[0]), known)
        return None if below is None else not below
    if name in ("and", "or"):
        parts = [truth(program, int(argument), known) for argument in arguments]
        decisive = name == "or"
        if decisive in parts:
            return decisive
        return None if None in parts else not decisive
    return None
