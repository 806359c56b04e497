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
    """Return the rows in Markdown; "its time": what the work around it takes, with it relative to without."""
    heads = ("item", "switch", "default", "without → with", "saved", "its time", "error")
    lines = []
    for row in rows:
        cost = f"{row['off']:.6g} → {row['on']:.6g} {row['unit']}"
        saved, error = f"{row['saving']:.0%}", f"{row['error']:.2g} ({row['error_of']})"
        lines.append((row["item"], f"`{row['switch']}`", row["default"], cost, saved, _time(row), error))
    return markdown(heads, lines)


def _time(row: dict[str, Any]) -> str:
    """Return the processor time with the saving, relative to that without; "" where not measured."""
    if row["processor_seconds"] is None:
        return ""
    off, on = row["processor_seconds"]
    return f"× {on / off:.2f}"
