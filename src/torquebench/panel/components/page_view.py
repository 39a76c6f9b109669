"""Show a result's description: facts, tables, charts, and figures drawn on another thread."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
from nicegui import background_tasks, ui

from torquebench.figures import translated_labels
from torquebench.panel.components.charts import Chart, Line, limit_lines, named, palette
from torquebench.panel.components.elements import (
    box,
    in_thread,
    note,
    pairs,
    panel,
    refilled,
    table,
    words,
)
from torquebench.panel.text import Text
from torquebench.reports.curve_figures import Panel
from torquebench.reports.page import Block, Diagram, Drawings, Facts, Figure, Page, Section, Table
from torquebench.units import minus_signs

SYMBOLS = {"^": "triangle", "v": "arrow", "s": "rect", "D": "diamond"}
LINES = ("-", "--", ":", "")


def show_page(text: Text, page: Page) -> None:
    """Show every section in a separate panel; details are collapsed."""
    for section in page.sections:
        heading = text(section.heading) or text(page.title)
        if section.detail:
            with panel(), box("details"):
                words("summary", heading)
                with box("div", "stack"):
                    _content(text, section)
        else:
            with panel(heading), box("div", "stack"):
                _content(text, section)


def _content(text: Text, section: Section) -> None:
    if section.text:
        words("p", text.sentence(section.text))
    show_blocks(text, section.blocks)


def show_blocks(text: Text, blocks: Iterable[Block]) -> None:
    """Show the content of a section."""
    for block in blocks:
        if isinstance(block, Facts):
            pairs([(text(name), minus_signs(text(value))) for name, value in block.items])
        elif isinstance(block, Table):
            _table(text, block)
        elif isinstance(block, Diagram):
            show_diagram(text, block)
        elif isinstance(block, Drawings):
            _drawings(text, block)
        else:
            _figure(text, block)


def _table(text: Text, block: Table) -> None:
    sentences = block.sentences
    columns = [
        (text(heading), not (number == 0 or block.words or sentences[number]))
        for number, heading in enumerate(block.header)
    ]
    rows = [[minus_signs(text(cell)) for cell in row] for row in block.rows]
    caption = text(block.caption)
    table(caption, columns, rows, best=block.emphasised)
    if caption:
        words("p", caption, "small muted")


def show_diagram(text: Text, diagram: Diagram, *, tall: bool = False) -> None:
    """Show the charts of a diagram side by side, with its caption."""
    lines = [_lines(text, part) for part in diagram.panels]
    level = any(map(named, lines))
    with box("div", "columns"):
        for part, drawn in zip(diagram.panels, lines, strict=True):
            with box("div"):
                if part.title:
                    words("h3", text(part.title))
                label = text(part.title) or text(diagram.caption)
                Chart(
                    label,
                    text(part.abscissa),
                    text(part.ordinate),
                    drawn,
                    tall=tall,
                    level=level,
                    logarithmic=part.logarithmic,
                )
    if diagram.caption:
        words("p", text(diagram.caption), "small muted")


def _lines(text: Text, part: Panel) -> list[Line]:
    colours = iter(palette(part.side) * 3)
    lines = []
    for curve in part.curves:
        points = part.markers or curve.style not in LINES
        lines.append(
            Line(
                text(curve.label) or text(part.ordinate),
                np.asarray(curve.x).tolist(),
                np.asarray(curve.y).tolist(),
                "--series-raw" if curve.raw else next(colours),
                points=points and curve.style not in ("-", "--", ":"),
                symbol=SYMBOLS.get(curve.style, "circle"),
            )
        )
    if part.limits and lines:
        xs: Sequence[Any] = [
            float(x) for curve in part.curves for x in (min(curve.x), max(curve.x))
        ]
        low, high = min(part.limits), max(part.limits)
        lines.append(limit_lines(text("limit"), min(xs), max(xs), low, high))
    return lines


def _figure(text: Text, figure: Figure) -> None:
    with box("figure", "figure drawing"):
        ui.html(figure.svg, sanitize=False)
        words("figcaption", text(figure.caption), "small muted")


def _drawings(text: Text, drawings: Drawings) -> None:
    """Draw on another thread, and show the figures when they are done."""
    place = box("div", "stack", aria_busy="true")
    with place:
        words("p", text("Drawing the figures"), "muted")

    def draw() -> list[Figure]:
        with nullcontext() if text.language == "en" else translated_labels(text.label):
            return [Figure(*each) for each in drawings.draw()]

    async def show() -> None:
        drawn = await in_thread(draw)
        if place.is_deleted:
            return
        place.props["aria-busy"] = "false"
        with refilled(place):
            for figure in drawn or ():
                _figure(text, figure)

    background_tasks.create(show(), name="drawings")


def remarks(text: Text, said: Iterable[str]) -> None:
    """Show the warnings of a result, each once."""
    for remark in dict.fromkeys(said):
        note(text.sentence(remark), "warn")
