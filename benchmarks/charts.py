"""Draw the charts of docs/benchmarks.md from its own tables, so that both agree.

``python -m benchmarks.charts`` after a table has changed; a test compares charts and tables.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.reporting import BENCHMARKS

__all__ = ["CHARTS", "FOLDER", "draw", "said", "table_under"]

FOLDER = BENCHMARKS.parent / "images" / "benchmarks"
BLUE, ORANGE = "#1f5fa8", "#c2571a"
NO_UPPER_LIMIT = ("≥", "10⁻", "100", "–", "U +")
"""How an aim begins that isn't an upper limit, or not one number."""
COLOURS = (BLUE, ORANGE, "#5b8c3a")


def table_under(heading: str, document: Path = BENCHMARKS) -> list[list[str]]:
    """Return the cells of the first table under a heading, head line first."""
    text = document.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    start = text.index("\n|") + 1
    lines = text[start:].split("\n\n", 1)[0].splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if line[:1] == "|"
    ]
    return [row for row in rows if not set("".join(row)) <= set("- ")]


def _numbers(cell: str) -> list[float]:
    return [
        float(found.replace(",", "")) for found in re.findall(r"\d[\d,]*\.?\d*(?:e[+-]\d+)?", cell)
    ]


def _number(cell: str) -> float:
    return next(iter(_numbers(cell)), float("nan"))


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:,.0f}"


def _bars(
    labels: list[str],
    columns: dict[str, list[float]],
    unit: str,
    *,
    mark: float | None = None,
    log: bool = False,
) -> Figure:
    figure = Figure(figsize=(7.5, 0.9 + 0.2 * len(labels) * (len(columns) + 1)))
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    height = 0.8 / len(columns)
    for number, (name, values) in enumerate(columns.items()):
        places = [row + number * height for row in range(len(values))]
        bars = axes.barh(places, values, height * 0.9, label=name, color=COLOURS[number])
        axes.bar_label(bars, [_short(value) for value in values], padding=3, fontsize=8)
    wrapped = [textwrap.fill(label.replace("`", ""), 36) for label in labels]
    axes.set_yticks([row + 0.4 - height / 2 for row in range(len(labels))], wrapped, fontsize=9)
    axes.invert_yaxis()
    if mark is not None:
        axes.axvline(mark, color="0.4", linewidth=1)
    if log:
        axes.set_xscale("log")
    axes.margins(x=0.12)
    axes.set_xlabel(unit)
    if len(columns) > 1:
        figure.legend(loc="outside upper right", ncols=len(columns), frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _ratios(heading: str, columns: tuple[int, int], most: float) -> Figure:
    rows = table_under(heading)[1:]
    kept = [row for row in rows if all(_number(row[column]) < most for column in columns)]
    names = ("50 points", "200 points")
    values = {
        name: [_number(row[column]) for row in kept]
        for name, column in zip(names, columns, strict=True)
    }
    return _bars([row[0] for row in kept], values, "RMS error / bound (1: known form)", mark=1.0)


def _columns(
    heading: str, columns: dict[str, int], unit: str, *, log: bool = False, which: int = 0
) -> Figure:
    """Draw columns of a table as bars, a group for each row; `which` number of a cell."""
    rows = [row for row in table_under(heading)[1:] if row[0] != "together"]
    values = {
        name: [_numbers(row[column])[which] for row in rows] for name, column in columns.items()
    }
    return _bars([row[0] for row in rows], values, unit, log=log)


def _shares(heading: str, value: int, aim: int, unit: str, which: int = -1) -> Figure:
    """Draw what was measured as a share of its aim; rows without an upper limit are left out."""
    labels, shares, part = [], [], ""
    for row in table_under(heading)[1:]:
        if not any(row[1:]):
            part = row[0].split(" (")[0] + ": "
        elif not row[aim].startswith(NO_UPPER_LIMIT) and _numbers(row[value]):
            labels.append(part + row[0].split(":")[0])
            shares.append(_numbers(row[value])[which] / _number(row[aim].removeprefix("≤ ")))
    return _bars(labels, {"": shares}, unit, mark=1.0)


def _panels(heading: str) -> Figure:
    """Draw each row on an axis of its own: units differ."""
    head, *rows = table_under(heading)
    figure = Figure(figsize=(7.5, 2.4), layout="constrained")
    for axes, row in zip(figure.subplots(1, len(rows)), rows, strict=True):
        bars = axes.bar(head[1:], [_number(cell) for cell in row[1:]], 0.6, color=COLOURS[:2])
        axes.bar_label(bars, row[1:], fontsize=8)
        axes.set_title(row[0], fontsize=9)
        axes.set_ylabel(row[1].split()[-1])
        axes.margins(y=0.15)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _plant(heading: str) -> Figure:
    head, *rows = table_under(heading)
    figure = Figure(figsize=(7.5, 2.8), layout="constrained")
    axes = figure.add_subplot()
    runs = [_number(cell) for cell in head[1:4]]
    for row, colour in zip(rows[:2], COLOURS, strict=False):
        times = [_number(cell) for cell in row[1:4]]
        axes.semilogx(runs, times, "o-", color=colour, label=row[0].split(",")[0])
    axes.axhline(_number(rows[0][4]), color="0.4", linewidth=1, label="aim")
    axes.set_xlabel("runs")
    axes.set_ylabel("time (95 %), ms")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside upper right", ncols=3, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
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


SHARE = "measured / aim (1: aim)"
CHARTS: dict[str, tuple[str, Callable[[str], Figure]]] = {
    "families": ("How well does the default model compensate?", lambda q: _ratios(q, (1, 4), 10.0)),
    "models": ("How do the models compare?", lambda q: _ratios(q, (1, 2), 20.0)),
    "points": ("How many points does a calibration need?", _points),
    "reducers": (
        "How accurate are reducer tests?",
        lambda q: _shares(q, 3, 4, "95 % of errors / aim (1: aim)", which=1),
    ),
    "efficiency": (
        "How well is an efficiency known?",
        lambda q: _columns(
            q, {"largest U": 2, "aim": 3}, "U (k = 2), % of the efficiency", which=-1
        ),
    ),
    "opcua": (
        "Does the OPC UA server keep memory of clients that reconnect?",
        lambda q: _columns(q, {"growth": 2, "aim": 3}, "growth of the panel's memory, %"),
    ),
    "safety": (
        "How fast is the bench made safe?",
        lambda q: _columns(
            q,
            {"alone": 1, "beside 4 programs": 2, "beside a Python thread": 3},
            "time to zero command (99 %), ms",
            which=1,
        ),
    ),
    "faults": (
        "What do faults leave behind?",
        lambda q: _columns(q, {"faults": 1, "survived": 3}, "faults"),
    ),
    "signals": ("How fast is the signal path?", lambda q: _shares(q, 1, 2, SHARE)),
    "files": (
        "How fast are files of readings?",
        lambda q: _columns(q, {"measured": 1, "aim": 2}, "wall time of apply / PyArrow"),
    ),
    "imports": (
        "How long do imports take?",
        lambda q: _columns(q, {"with scikit-learn": 1, "now": 2}, "processor time of imports, s"),
    ),
    "registry": ("How large may the registry grow?", _panels),
    "plant": ("How large may a plant grow?", _plant),
    "panel": ("How responsive is the panel?", lambda q: _shares(q, 1, 2, SHARE)),
    "dynamics": (
        "What do dynamic filters cost and gain?",
        lambda q: _columns(q, {"": 2}, "times as fast as PyDynamic", log=True),
    ),
    "rotating": (
        "How accurate are rotating chains?",
        lambda q: _columns(
            q, {"static only": 1, "compensated": 2, "known form": 3}, "RMS error, % FS"
        ),
    ),
    "turning": (
        "How accurate is the simulated bench while it rotates?",
        lambda q: _columns(q, {"raw": 1, "static only": 2, "compensated": 3}, "worst error, % FS"),
    ),
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
