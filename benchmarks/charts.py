"""Draw the charts of docs/benchmarks.md from its own tables, so that both agree.

``python -m benchmarks.charts`` after a table has changed; a test compares charts and tables.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.section import BENCHMARKS

__all__ = ["CHARTS", "FOLDER", "draw", "said", "table_under"]

FOLDER = BENCHMARKS.parent / "images" / "benchmarks"
BLUE, ORANGE = "#1f5fa8", "#c2571a"


def table_under(heading: str, document: Path = BENCHMARKS) -> list[list[str]]:
    """Return the cells of the first table under a heading, head line first."""
    text = document.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in rows if not set("".join(row)) <= set("- ")]


def _number(cell: str) -> float:
    found = re.match(r"[\d.]+", cell)
    return float(found[0]) if found else float("nan")


def _bars(axes: Axes, labels: list[str], columns: dict[str, list[float]], unit: str) -> None:
    height = 0.8 / len(columns)
    colours = (BLUE, ORANGE)
    for number, (name, values) in enumerate(columns.items()):
        places = [row + number * height for row in range(len(values))]
        bars = axes.barh(places, values, height * 0.9, label=name, color=colours[number])
        axes.bar_label(bars, [f"{value:.2f}" for value in values], padding=3, fontsize=8)
    axes.set_yticks([row + 0.4 - height / 2 for row in range(len(labels))], labels)
    axes.invert_yaxis()
    axes.axvline(1.0, color="0.4", linewidth=1)
    axes.set_xlabel(unit)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def _ratios(heading: str, columns: tuple[int, int], most: float) -> Figure:
    rows = table_under(heading)[1:]
    kept = [row for row in rows if all(_number(row[column]) < most for column in columns)]
    figure = Figure(figsize=(7.5, 0.5 + 0.42 * len(kept)), layout="constrained")
    names = ("50 points", "200 points")
    values = {
        name: [_number(row[column]) for row in kept]
        for name, column in zip(names, columns, strict=True)
    }
    _bars(
        figure.add_subplot(), [row[0] for row in kept], values, "RMS error / bound (1: known form)"
    )
    return figure


def _points(heading: str) -> Figure:
    rows = table_under(heading)[1:]
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for kind, colour in (("even", BLUE), ("placed", ORANGE)):
        own = [row for row in rows if row[0].endswith(kind)]
        counts = [_number(row[0]) for row in own]
        for column, style, name in ((1, "o-", "worst error"), (2, "s--", "RMS error")):
            values = [_number(row[column]) for row in own]
            axes.plot(counts, values, style, color=colour, label=f"{kind}, {name}")
    axes.set_xlabel("calibration points")
    axes.set_ylabel("error, % FS")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside right upper", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


CHARTS: dict[str, tuple[str, Callable[[str], Figure]]] = {
    "families": ("How well does the default model compensate?", lambda q: _ratios(q, (1, 4), 10.0)),
    "models": ("How do the models compare?", lambda q: _ratios(q, (1, 2), 20.0)),
    "points": ("How many points does a calibration need?", _points),
}
"""Question and drawing of every chart, by name."""


def said(heading: str) -> str:
    """Return a table in one line; the chart carries it, so that a test can compare both."""
    return "; ".join(", ".join(row) for row in table_under(heading))


def draw(folder: Path = FOLDER) -> list[Path]:
    """Draw every chart as SVG."""
    import matplotlib as mpl

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    with mpl.rc_context({"svg.hashsalt": "torquebench", "svg.fonttype": "path"}):
        for name, (heading, make) in CHARTS.items():
            path = folder / f"{name}.svg"
            metadata = {"Date": None, "Creator": None, "Description": said(heading)}
            make(heading).savefig(path, metadata=metadata)
            paths.append(path)
    return paths


if __name__ == "__main__":
    for drawn in draw():
        print(drawn)
