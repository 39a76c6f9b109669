"""Draw the charts of docs/benchmarks.md from its own tables, so that both agree.

`python -m tests.pictures charts` after a table has changed; a test compares charts and tables.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from benchmarks.reporting import BENCHMARKS
from matplotlib.figure import Figure

FOLDER = BENCHMARKS.parent / "images" / "benchmarks"
COLOURS = ("#1f5fa8", "#c2571a")


def table_under(heading: str, document: Path = BENCHMARKS) -> list[list[str]]:
    """Return the cells of the first table under a heading, head line first."""
    text = document.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    start = text.index("\n|") + 1
    lines = text[start:].split("\n\n", 1)[0].splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if line[:1] == "|"
    ]
    return [row for row in rows if not set("".join(row)) <= set("- ")]


def _ratios(heading: str, columns: dict[str, int]) -> Figure:
    """Draw columns of a table as bars, a group for each row; 1 is marked."""
    rows = table_under(heading)[1:]
    figure = Figure(figsize=(7.5, 0.9 + 0.12 * len(rows) * (len(columns) + 1)))
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    height = 0.8 / len(columns)
    for number, (name, column) in enumerate(columns.items()):
        values = [float(re.findall(r"\d+\.?\d*", row[column])[0]) for row in rows]
        places = [row + number * height for row in range(len(values))]
        bars = axes.barh(places, values, height * 0.9, label=name, color=COLOURS[number])
        axes.bar_label(bars, [f"{value:.3g}" for value in values], padding=3, fontsize=7)
    axes.set_yticks([row + 0.4 - height / 2 for row in range(len(rows))], [row[0] for row in rows])
    axes.invert_yaxis()
    axes.axvline(1.0, color="0.4", linewidth=1)
    axes.margins(x=0.12)
    axes.set_xlabel("RMS error / bound (1: known form)")
    figure.legend(loc="outside upper right", ncols=len(columns), frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


CHARTS: dict[str, tuple[str, Callable[[str], Figure]]] = {
    "families": (
        "How well does the default model compensate?",
        lambda heading: _ratios(heading, {"50 points": 1, "200 points": 3}),
    ),
}
"""Question and drawing of every chart, by name."""


def said(heading: str) -> str:
    """Return a table in one line; the chart carries it, so that a test can compare both."""
    return "; ".join(", ".join(row) for row in table_under(heading))


def draw(folder: Path) -> list[Path]:
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


def make(images: Path, _scratch: Path) -> list[Path]:
    """Draw them where the documentation has them."""
    return draw(images / FOLDER.name)
