"""Measured metals in RGB: a reader of `metals.json`, which `python -m tools.generate_metals` writes."""

import functools
import json
from importlib import resources
from typing import Any


@functools.cache
def table() -> dict[str, Any]:
    """The data file: `provenance`, and under `metals` one record a chemical symbol. Not to be written to."""
    return json.loads(resources.files("torchms.fresnel").joinpath("metals.json").read_text(encoding="utf-8"))


def known() -> list[str]:
    """Chemical symbols of the metals in the table, in alphabetical order."""
    return sorted(table()["metals"])


def lookup(name: str) -> tuple[list[float], list[float]]:
    """(eta, k) in linear sRGB of the metal called `name`: chemical symbol or English name, in any letter case.

    Raises ValueError, listing the known names, for any other.
    """
    metals = table()["metals"]
    wanted = name.strip().casefold()
    for symbol, record in metals.items():
        if wanted in (symbol.casefold(), *record["names"]):
            return record["eta"], record["k"]
    listing = ", ".join(f"{symbol} ({', '.join(metals[symbol]['names'])})" for symbol in known())
    raise ValueError(
        f"Conductor.metal(name) must name a metal of the table; got {name!r}. Known: {listing}. "
        "For another give Conductor(eta, k)."
    )
