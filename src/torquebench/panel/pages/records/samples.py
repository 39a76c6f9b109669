"""Raw samples of a run over time, and those of other runs on the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from urllib.parse import urlencode

import numpy as np
from nicegui import background_tasks, ui

from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.elements import box, refilled
from torquebench.panel.pages.records.column_titles import column_with_unit
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import Marker
from torquebench.panel.service.live.rings import Rows
from torquebench.records import RunSummary

__all__ = ["RunSamples", "run_address"]

POINTS = 1000
MOST_RUNS = len(COLOURS)
OFFERED = 100


def run_address(run_id: str) -> str:
    """Return the address of a run's page."""
    return f"/runs/{run_id}"


class RunSamples:
    """A chart of one column of a run, and of the runs that the address names under `with`.

    Parameters
    ----------
    visitor : Visitor
    run : RunSummary
    columns : sequence of str
        Columns of its raw samples.
    annotations : sequence of Marker
    """

    def __init__(
        self,
        visitor: Visitor,
        run: RunSummary,
        columns: Sequence[str],
        annotations: Sequence[Marker],
    ) -> None:
        self._visitor, self._text, self._run = visitor, visitor.text, run
        self._annotations = annotations
        query = visitor.query
        named = [each for each in query.get("with", "").split(",") if each not in ("", run.run_id)]
        self._others = list(dict.fromkeys(named))[: MOST_RUNS - 1]
        chosen = [name for name in columns if "torque" in name] or list(columns)
        chosen.sort(key=lambda name: name.partition("_")[0] not in run.kind)  # the run's side first
        self._column = query["column"] if query.get("column") in columns else chosen[0]
        self._titles = {name: column_with_unit(self._text, name, samples=True) for name in columns}

    def build(self) -> None:
        """Make the controls and the chart."""
        text = self._text
        with box("div", "columns"):
            Field(
                text("Raw samples of"), self._column, options=self._titles, on_change=self._choose
            )
            if len(self._others) < MOST_RUNS - 1:
                Field(text("Overlay another run"), "", options=self._offered(), on_change=self._add)
        if self._others:
            button(
                text("Remove the other runs"), lambda: self._go([]), "small", picture="layers_clear"
            )
        self._place = box("div")
        background_tasks.create(self._draw(self._column), name="samples")

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
        """Return the address of the page with this column and these runs."""
        query = {"column": self._column} | ({"with": ",".join(others)} if others else {})
        return f"{run_address(self._run.run_id)}?{urlencode(query, safe=',')}"

    async def _choose(self, column: str) -> None:
        self._column = column
        ui.navigate.history.replace(self._address(self._others))
        await self._draw(column)

    async def _draw(self, column: str) -> None:
        names = [self._run.run_id, *self._others]
        trend = self._visitor.service.records.run_trend
        found: dict[str, Rows] = {}
        for name in names:
            rows = await self._visitor.attempt_aside(partial(trend, name, [column], POINTS))
            if rows is not None and rows.time_s.size:
                found[name] = rows
        if self._place.is_deleted or self._column != column:
            return  # the page was left, or another column was chosen
        several = len(names) > 1  # each begins at its own 0
        lines = [
            _extremes(
                name if several else self._titles[column],
                rows,
                float(rows.time_s[0]) if several else 0.0,
                COLOURS[(place + 1) % len(COLOURS)],
            )
            for place, (name, rows) in enumerate(found.items())
        ]
        if self._annotations and self._run.run_id in found:
            rows = found[self._run.run_id]
            begin_s = float(rows.time_s[0]) if several else 0.0
            highest = rows.high[np.isfinite(rows.high)]
            lines.append(self._noted(float(highest.max()) if highest.size else 0.0, begin_s))
        with refilled(self._place):
            Chart(
                self._text("Raw samples of {name} over time.", name=self._titles[column]),
                self._text("Time from the start, s" if several else "time, s"),
                self._titles[column],
                lines,
            )

    def _noted(self, top: float, begin_s: float) -> Line:
        return Line(
            self._text("Annotations"),
            [each.bench_time_s - begin_s for each in self._annotations],
            [top] * len(self._annotations),
            "--warn",
            points=True,
            symbol="pin",
            labels=[each.note for each in self._annotations],
        )


def _extremes(title: str, rows: Rows, begin_s: float, colour: str) -> Line:
    """Draw the minimum and maximum of each span, so that no spike is lost."""
    x = np.repeat(rows.time_s - begin_s, 2).tolist()
    y = np.column_stack((rows.low[0], rows.high[0])).ravel().tolist()
    return Line(title, x, y, colour)
