"""The table of savings: what each one costs without it and with it, and what error it makes."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from benchmarks._tables import markdown


class Row(NamedTuple):
    """One item."""

    item: str
    switch: str
    default: str
    unit: str
    off: float
    on: float
    error: float
    error_of: str
    processor_seconds: tuple[float, float] | None = None
    """Off and on."""

    def figures(self) -> dict[str, Any]:
        """Return the row with what it saves."""
        values = {k: round(v, 6) if isinstance(v, float) else v for k, v in self._asdict().items()}
        return {**values, "saving": round(1 - self.on / self.off, 4) if self.off else 0.0}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows in Markdown."""
    heads = ("item", "switch", "default", "without → with", "saved", "error")
    lines = []
    for row in rows:
        cost = f"{row['off']:.6g} → {row['on']:.6g} {row['unit']}"
        saved, error = f"{row['saving']:.0%}", f"{row['error']:.2g} ({row['error_of']})"
        lines.append((row["item"], f"`{row['switch']}`", row["default"], cost, saved, error))
    return markdown(heads, lines)
