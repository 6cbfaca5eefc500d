"""Finished shards on disk: a directory with one configuration and one atomic file a shard."""

import io
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchms.microsurface.simulation.partial import Partial
from torchms.microsurface.simulation.plan import Plan, Shard
from torchms.storage.archives import read_arrays
from torchms.storage.write import read_json, remove_leftovers, write_whole

CONFIGURATION = "configuration.json"
HEADERS = 4096
"""Bytes that an array may take in a file beyond its numbers."""


@dataclass(frozen=True)
class Checkpoint:
    """Where the shards of one `Plan` are kept; several processes may use one directory."""

    directory: Path
    plan: Plan

    @staticmethod
    def open(directory: Path, plan: Plan) -> "Checkpoint":
        """The checkpoint in `directory`, made if need be.

        Raises ValueError that names each difference if it belongs to another configuration, OSError if it cannot be
        made.
        """
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise NotADirectoryError(
                f"simulate(checkpoint=...) must be a directory; {directory} or one above it is a file."
            ) from error
        remove_leftovers(directory, "shard-*.npz")
        mine = json.loads(json.dumps(plan.configuration()))
        path = directory / CONFIGURATION
        if not path.exists():
            if any(directory.glob("shard-*.npz")):
                raise ValueError(
                    f"simulate(checkpoint=...): {directory} holds shards but no {CONFIGURATION}; nobody can "
                    "tell what they belong to. Name an empty directory."
                )
            # Workers that start together write the same bytes.
            content = json.dumps(mine, indent=1).encode()
            write_whole(path, content, force=True)
            return Checkpoint(directory, plan)
        try:
            theirs = read_json(path)
            if not isinstance(theirs, dict):
                raise ValueError(f"it holds {_short(theirs)}")
        except ValueError as error:
            raise ValueError(
                f"simulate(checkpoint=...): {path} is no configuration ({error}). Name another directory."
            ) from error
        different = differences(theirs, mine)
        if different:
            raise ValueError(
                f"simulate(checkpoint=...): {directory} belongs to another configuration. It has "
                + "; ".join(f"{key} = {_short(a)} where this run has {_short(b)}" for key, a, b in different[:20])
                + ". Name another directory, or run with its configuration."
            )
        return Checkpoint(directory, plan)

    def path(self, shard: Shard) -> Path:
        """File of one shard."""
        return self.directory / f"shard-{shard.number:06d}.npz"

    def save(self, shard: Shard, found: Partial) -> None:
        """Keep one finished shard."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **found.arrays())
        write_whole(self.path(shard), buffer.getvalue(), force=True, sweep=False)

    def load(self, shard: Shard) -> Partial | None:
        """A finished shard, or None if it has to be traced (an unreadable file is reported, and traced again)."""
        path = self.path(shard)
        if not path.exists():
            return None
        expected = Partial.zeros(1, 1, self.plan.max_order, self.plan.material.channels, self.plan.lobes).arrays()
        try:
            arrays = read_arrays(path, sum(array.nbytes for array in expected.values()) + HEADERS * len(expected))
        except ValueError as error:
            warnings.warn(f"Checkpoint: {path} cannot be read ({error}); the shard is traced again.", stacklevel=2)
            return None
        for name, array in expected.items():
            if name not in arrays or arrays[name].shape != array.shape or arrays[name].dtype != array.dtype:
                warnings.warn(f"Checkpoint: {path} is not of this plan; the shard is traced again.", stacklevel=2)
                return None
        return Partial(**arrays)


def _short(value: Any) -> str:
    """`value` for a message."""
    text = str(value)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def differences(theirs: Any, mine: Any, key: str = "") -> list[tuple[str, Any, Any]]:
    """Dotted keys at which two configurations differ, with both values."""
    if isinstance(theirs, dict) and isinstance(mine, dict):
        out = []
        for name in [*theirs, *(n for n in mine if n not in theirs)]:
            inner = f"{key}.{name}" if key else name
            out += differences(theirs.get(name, "nothing"), mine.get(name, "nothing"), inner)
        return out
    return [] if theirs == mine else [(key, theirs, mine)]
