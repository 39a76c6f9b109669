"""Raw samples of a run over time, and those of other runs on the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from urllib.parse import urlencode

import numpy as np
from nicegui import background_tasks, ui

from torquebench.errors import InputError
from torquebench.panel.components.charts import COLOURS, Chart, Line, palette
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.elements import box, refilled, words
from torquebench.panel.pages.records.column_titles import column_with_unit
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import Marker
from torquebench.panel.service.live.rings import Rows
from torquebench.records import RunSummary

POINTS = 1000
MOST_RUNS = len(COLOURS)
OFFERED = 100


def run_address(run_id: str) -> str:
    """Return the address of a run's page."""
    return f"/runs/{run_id}"


class RunSamples:
    """A chart of one column of a run, and of the runs that the address names under `with`.

    `from` and `to` in the address are the ends of a span, in seconds from the start of each run.

    Parameters
    ----------
    visitor : Visitor
    run : RunSummary
    columns : sequence of str
        Columns of its raw samples.
    annotations : sequence of Marker
    begin_s : float
        Bench time of its first sample.
    """

    def __init__(
        self,
        visitor: Visitor,
        run: RunSummary,
        columns: Sequence[str],
        annotations: Sequence[Marker],
        begin_s: float,
    ) -> None:
        self._visitor, self._text, self._run = visitor, visitor.text, run
        self._annotations, self._begin_s = annotations, begin_s
        query = visitor.query
        named = [each for each in query.get("with", "").split(",") if each not in ("", run.run_id)]
        self._others = list(dict.fromkeys(named))[: MOST_RUNS - 1]
        chosen = [name for name in columns if "torque" in name] or list(columns)
        chosen.sort(key=lambda name: name.partition("_")[0] not in run.kind)  # the run's side first
        self._column = query["column"] if query.get("column") in columns else chosen[0]
        self._titles = {name: column_with_unit(self._text, name, samples=True) for name in columns}
        self._span = _span(query.get("from", ""), query.get("to", ""))

    def build(self) -> None:
        """Make the controls and the chart."""
        text = self._text
        with box("div", "columns"):
            Field(
                text("Raw samples of"), self._column, options=self._titles, on_change=self._choose
            )
            if len(self._others) < MOST_RUNS - 1:
                Field(text("Overlay another run"), "", options=self._offered(), on_change=self._add)
            self._ends = [
                Field(text(title), kind="number", unit="s", step="any", min="0")
                for title in ("Span from", "Span to")
            ]
        with box("div", "line"):
            button(text("Show span"), self._show_typed, "small", picture="zoom_in")
            self._whole = box("span")
            if self._others:
                button(
                    text("Remove the other runs"),
                    lambda: self._go([]),
                    "small",
                    picture="layers_clear",
                )
        words("p", text("Draw a span in the chart with the mouse to enlarge it."), "muted small")
        self._place = box("div")
        background_tasks.create(self._draw(), name="samples")

    async def _show_typed(self) -> None:
        """Show the span that was typed in; an empty end is that of the run."""
        span = _span(*(field.value for field in self._ends))
        if span is None:
            self._visitor.messages.problem(
                InputError(
                    "a span without a length", "a start before its end", "type both in seconds"
                )
            )
            return
        await self._hold(span)

    async def _hold(self, span: tuple[float, float] | None) -> None:
        """Show a span, or the whole run, and keep it in the address."""
        self._span = span
        ui.navigate.history.replace(self._address(self._others))
        await self._draw()

    def _show_ends(self) -> None:
        ends = ("", "") if self._span is None else tuple(f"{end:.6g}" for end in self._span)
        for field, end in zip(self._ends, ends, strict=True):
            field.set(end if end != "inf" else "")
        with refilled(self._whole):
            if self._span is not None:
                button(
                    self._text("Whole run"), lambda: self._hold(None), "small", picture="zoom_out"
                )

    def _offered(self) -> dict[str, str]:
        runs = self._visitor.service.records.runs(limit=OFFERED).runs
        shown = {self._run.run_id, *self._others}
        ended = (run for run in runs if run.run_id not in shown and run.finished is not None)
        return {"": self._text("Choose a run")} | {run.run_id: run.run_id for run in ended}

    def _add(self, run_id: str) -> None:
        if run_id:
            self._go([*self._others, run_id])

    def _go(self, others: Sequence[str]) -> None:
        ui.navigate.to(self._address(others))

    def _address(self, others: Sequence[str]) -> str:
        """Return the address of the page with this column, this span and these runs."""
        query = {"column": self._column} | ({"with": ",".join(others)} if others else {})
        if self._span is not None:
            query |= {"from": f"{self._span[0]:.6g}", "to": f"{self._span[1]:.6g}"}
        return f"{run_address(self._run.run_id)}?{urlencode(query, safe=',')}"

    async def _choose(self, column: str) -> None:
        self._column = column
        ui.navigate.history.replace(self._address(self._others))
        await self._draw()

    async def _draw(self) -> None:
        column, span = self._column, self._span
        self._show_ends()
        found = await self._visitor.attempt_aside(partial(self._read, column, span))
        if found is None or self._place.is_deleted or (column, span) != (self._column, self._span):
            return  # the page was left, or something else was chosen
        lines = [
            _extremes(
                name if self._others else self._titles[column],
                rows,
                begin_s,
                colour,
            )
            for colour, (name, (rows, begin_s)) in zip(
                palette(column.partition("_")[0]) * 2, found.items(), strict=False
            )
        ]
        if self._run.run_id in found:
            lines += self._noted(found[self._run.run_id][0])
        with refilled(self._place):
            Chart(
                self._text("Raw samples of {name} over time.", name=self._titles[column]),
                self._text("Time from the start, s"),
                self._titles[column],
                lines,
                on_span=lambda start, stop: self._hold((max(start, 0.0), stop)),
            )

    def _read(self, column: str, span: tuple[float, float] | None) -> dict[str, tuple[Rows, float]]:
        """Return the samples of every run that has some in the span, and its begin, s."""
        records = self._visitor.service.records
        found = {}
        for name in (self._run.run_id, *self._others):
            rows = records.run_trend(name, [column], POINTS, span)
            if rows.time_s.size:
                found[name] = rows, records.run_begin_s(name)
        return found

    def _noted(self, rows: Rows) -> list[Line]:
        """Return the annotations of the shown span as pins above the samples."""
        first_s, last_s = float(rows.time_s[0]), float(rows.time_s[-1])
        shown = [each for each in self._annotations if first_s <= each.bench_time_s <= last_s]
        highest = rows.high[np.isfinite(rows.high)]
        top = float(highest.max()) if highest.size else 0.0
        pins = Line(
            self._text("Annotations"),
            [each.bench_time_s - self._begin_s for each in shown],
            [top] * len(shown),
            "--warn",
            points=True,
            symbol="pin",
            labels=[each.note for each in shown],
        )
        return [pins] if shown else []


def _span(start: str, stop: str) -> tuple[float, float] | None:
    """Return a span as it stands in an address or in fields, s; None if it has no length."""
    try:
        span = max(float(start or "0"), 0.0), float(stop or "inf")
    except ValueError:
        return None
    return span if (start or stop) and span[0] < span[1] else None


def _extremes(title: str, rows: Rows, begin_s: float, colour: str) -> Line:
    """Draw the minimum and maximum of each span, so that no spike is lost."""
    x = np.repeat(rows.time_s - begin_s, 2).tolist()
    y = np.column_stack((rows.low[0], rows.high[0])).ravel().tolist()
    return Line(title, x, y, colour)
