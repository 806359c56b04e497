"""Fronts of error against cost, as pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

mpl.use("Agg")  # no screen is needed, or asked for


class Curve(NamedTuple):
    """A line of a panel."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    chosen: int | None = None
    """Which point is the default."""
    labels: Sequence[str] = ()
    """Words beside the points; none for ""."""


class Panel(NamedTuple):
    """A set of axes, the horizontal one logarithmic."""

    x: str
    y: str
    curves: Sequence[Curve]
    log_y: bool = False


def write_fronts(path: Path, panels: Sequence[Panel], title: str = "") -> None:
    """Draw the panels side by side, the chosen default marked with a star."""
    figure = Figure(figsize=(5.2 * len(panels), 4.2), layout="constrained")
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for curve in panel.curves:
            (line,) = axes.plot(curve.x, curve.y, marker="o", markersize=3.5, label=curve.name)
            if curve.chosen is not None:
                at = ([curve.x[curve.chosen]], [curve.y[curve.chosen]])
                axes.plot(*at, marker="*", markersize=15, color=line.get_color(), linestyle="none")
            for x, y, label in zip(curve.x, curve.y, curve.labels, strict=False):
                axes.annotate(label, (x, y), xytext=(6, -10), textcoords="offset points", fontsize=8)
        axes.set(xscale="log", xlabel=panel.x, ylabel=panel.y)
        _mark(axes.xaxis)
        if panel.log_y:
            axes.set_yscale("log")
            _mark(axes.yaxis)
        axes.grid(visible=True, which="both", alpha=0.25)
        axes.legend(fontsize=8)
    if title:
        figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def _mark(axis: Axis) -> None:
    """Write plain numbers at 1, 2 and 5 times the powers of ten: of powers alone there may be none."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
