"""The parity table: a line a file."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from torchms.onnx.parity.compare import Parity

FOOTNOTE = (
    "rel: |file - eager| / |eager|, largest and 99.9th percentile, for orders relative to their sum; sensitive: "
    "elements above the bound for which eager is as far from float64 itself or moves as much when its inputs move by a "
    "few ulps (a branch flips, a difference cancels), not in 'rel max'; rms: against float64, file / eager; ns a row, "
    "one thread each."
)


@dataclass(frozen=True)
class Entry:
    """One file of a set: its size in bytes and its comparison, or why there is none."""

    name: str
    size: int = 0
    nodes: int = 0
    export_s: float = 0.0
    parity: Parity | None = None
    refused: str = ""

    @classmethod
    def of(cls, name: str, content: bytes, parity: Parity, export_s: float = 0.0) -> "Entry":
        """The entry of a file that was written and compared."""
        import onnx

        nodes = len(onnx.load_model_from_string(content).graph.node)
        return cls(name, len(content), nodes, export_s, parity)

    @property
    def failed(self) -> bool:
        """Whether a bound was missed."""
        return self.parity is not None and bool(self.parity.failures)

    def as_json(self) -> dict[str, Any]:
        parity = None if self.parity is None else self.parity.as_json()
        return {k: getattr(self, k) for k in ("name", "size", "nodes", "export_s", "refused")} | {"parity": parity}


def table(entries: Sequence[Entry]) -> str:
    """The entries in columns, Markdown."""
    head = [
        "file",
        "KB",
        "nodes",
        "abs max",
        "abs p99.9",
        "rel max",
        "rel p99.9",
        "sensitive",
        "rms",
        "file ns",
        "eager ns",
        "",
    ]
    lines = [head, ["---"] * len(head)] + [_line(entry) for entry in entries]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _line(entry: Entry) -> list[str]:
    if entry.parity is None:
        return [entry.name, *[""] * 10, f"refused: {entry.refused}"]
    p = entry.parity
    share = f"{p.sensitive} of {p.elements:.1e}" + (f", to {p.sensitive_max:.0e}" if p.sensitive else "")
    return [
        entry.name,
        f"{entry.size / 1e3:.0f}",
        str(entry.nodes),
        f"{p.abs_max:.1e}",
        f"{p.abs_p999:.1e}",
        f"{p.rel_max:.1e}",
        f"{p.rel_p999:.1e}",
        share,
        f"{p.rms_file:.1e} / {p.rms_eager:.1e}",
        f"{p.file_ns:.0f}",
        f"{p.eager_ns:.0f}",
        "MISSED: " + "; ".join(p.failures) if p.failures else "ok",
    ]
