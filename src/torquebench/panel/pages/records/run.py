"""The panel of one run: data, integrity, raw samples and points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import partial
from typing import Any

from nicegui import ui

from torquebench.bench.roles import SIDES
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.columns import Side
from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import Field, button, link_button
from torquebench.panel.components.elements import (
    box,
    note,
    pairs,
    panel,
    refilled,
    table,
    to_the_top,
    words,
)
from torquebench.panel.pages.calibrate.resume import resume_button
from torquebench.panel.pages.calibrate.start import calibration_address
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.operations.files import download
from torquebench.panel.pages.page import page
from torquebench.panel.pages.records.column_titles import (
    column_figures,
    column_title,
    column_unit_shown,
    column_with_unit,
    stream_title,
)
from torquebench.panel.pages.records.samples import RunSamples
from torquebench.panel.pages.visitor import Visitor, profile_titles
from torquebench.panel.service import InterruptedView, Marker, RunDetail, RunTable
from torquebench.panel.text import Text, Texts
from torquebench.units import minus_signs

SHOWN_ROWS = 12
MOST_DOUBTS = 5
Y_FIRST = ("error_nm", "reading_nm", "torque_nm")

RUN_KINDS: Texts = {
    "recording": "Recording",
    "calibrate-input": "Calibration, input module",
    "calibrate-output": "Calibration, output module",
    "verify-input": "Verification, input module",
    "verify-output": "Verification, output module",
    "check-input": "Daily check, input module",
    "check-output": "Daily check, output module",
    "zero": "Zeroing",
    "no-load-friction": "Friction of the output module",
    "bench-twist": "Twist of the bench",
    "dynamics-input": "Dynamics, input module",
    "dynamics-output": "Dynamics, output module",
    "empty-run": "Empty run, nothing mounted",
    "empty-run-input": "Empty run, input module",
    "empty-run-output": "Empty run, output module",
    "turning-calibration-input": "Turning calibration, input module",
    "turning-calibration-output": "Turning calibration, output module",
    "turning-verification-input": "Turning verification, input module",
    "turning-verification-output": "Turning verification, output module",
}


def compared_address(chosen: Iterable[str]) -> str:
    """Return the address of a chart with the errors of calibrations and runs."""
    named = ",".join(chosen)
    return f"/records?part=calibrations{'&with=' if named else ''}{named}"


def run_title(text: Text, kind: str) -> str:
    """Return the title of a kind of run."""
    name = kind.removeprefix("test-").removesuffix("-short")
    if not kind.startswith("test-") or name not in TESTS:
        return text(RUN_KINDS.get(kind, kind))
    title = TESTS[name].title
    return text(Message("{title}, short test", title) if kind.endswith("-short") else title)


def doubt_notes(text: Text, doubts: Iterable[str]) -> None:
    """Show doubts about records, each once."""
    said = list(dict.fromkeys(doubts))
    for doubt in said[:MOST_DOUBTS]:
        note(text(doubt), "warn", title=text("Doubtful"))
    if len(said) > MOST_DOUBTS:
        words(
            "p",
            text(
                "{count} more are doubtful: open them, or `torquebench records verify` "
                "names them all.",
                count=len(said) - MOST_DOUBTS,
            ),
            "muted",
        )


class _RunPanel:
    """The panel of an opened run.

    Parameters
    ----------
    visitor : Visitor
    run_id : str
    """

    def __init__(self, visitor: Visitor, run_id: str) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._run_id = run_id

    async def build(self, place: Any) -> None:
        """Read the run on another thread, and build the panel in an element."""
        read = await self._visitor.attempt_aside(self._read)
        if read is None or place.is_deleted:
            return
        with refilled(place):
            self._show(*read)
            to_the_top()

    def _read(self) -> tuple[RunDetail, tuple[str, ...], float]:
        records = self._visitor.service.records
        detail = records.run(self._run_id)
        try:
            return detail, records.run_columns(self._run_id), records.run_begin_s(self._run_id)
        except (TorquebenchError, OSError):  # the run has no raw samples
            return detail, (), 0.0

    def _show(self, detail: RunDetail, columns: Sequence[str], begin_s: float) -> None:
        text = self._text
        with panel(run_title(text, detail.run.kind)), box("div", "stack"):
            with box("div", "line"):
                if detail.run.finished is not None:
                    from torquebench.records.export.streams import STREAM_FORMATS  # 31 MB

                    archive = partial(self._export, "records export", f"{self._run_id}.zip")
                    button(text("Export as ZIP"), archive, picture="download")
                    formats = {"": text("Samples as …")} | {
                        name: name.upper() for name in STREAM_FORMATS
                    }
                    Field(
                        text("Samples as a file"), "", options=formats, on_change=self._export_data
                    )
                number = detail.calibration_id
                if number is not None:
                    address = calibration_address(number)
                    button(
                        text("Open in the wizard"), lambda: ui.navigate.to(address), picture="tune"
                    )
                elif (interrupted := self._interrupted(detail.run.status)) is not None:
                    resume_button(self._visitor, interrupted)
                button(text("Close"), lambda: ui.navigate.to("/records"), "quiet",
                       picture="close")  # fmt: skip
            if detail.changes:
                note("; ".join(detail.changes), "bad", title=text("Changed since it was sealed"))
            elif detail.run.finished is not None:
                note(text("Intact: every file is as it was when the run was sealed."), "good")
            doubt_notes(text, detail.run.doubts)
            pairs(self._facts(detail))
            self._annotations(detail.annotations, begin_s)
            if columns:
                RunSamples(self._visitor, detail.run, columns, detail.annotations, begin_s).build()
            for part in detail.tables:
                self._points(part, detail.run.kind)

    def _interrupted(self, status: str) -> InterruptedView | None:
        completed = status in ("completed", "running")
        return None if completed else self._visitor.service.records.interrupted(self._run_id)

    def _facts(self, detail: RunDetail) -> list[tuple[str, str | datetime]]:
        text, run = self._text, detail.run
        profiles = profile_titles(self._visitor)
        facts: list[tuple[str, str | datetime]] = [
            (text("Started"), run.started),
            (text("State"), text(run.status)),
            (text("By"), run.operator or "—"),
            (
                text("Profile"),
                profiles.get(run.profile_name, text(run.profile_name)) or "—",
            ),
            (text("Bench"), text(run.bench) or "—"),
            (text("Software"), run.software_version),
        ]
        for key, title in (
            ("title", text("Title")),
            ("note", text("Note")),
            ("trigger", text("Began")),
        ):
            if said := str(detail.metadata.get(key) or ""):
                facts.append((title, said))
        if run.reason:
            facts.insert(3, (text("Why it ended"), text(run.reason)))
        if run.simulated:
            facts.append((text("Data"), text("simulated")))
        return facts

    def _annotations(self, annotations: Sequence[Marker], begin_s: float) -> None:
        if not annotations:
            return
        text = self._text
        heads = [(text("Time from the start, s"), True), (text("Note"), False),
                 (text("By"), False)]  # fmt: skip
        rows = [
            (minus_signs(f"{each.bench_time_s - begin_s:.2f}"), each.note, each.who)
            for each in annotations
        ]
        table(text("Annotations"), heads, rows)

    def _points(self, part: RunTable, kind: str) -> None:
        text = self._text
        numbers = {
            name: values
            for name, values in part.columns.items()
            if values and all(isinstance(value, int | float) for value in values)
        }
        if not numbers:
            return
        title = stream_title(text, part.stream)
        words(
            "h3", text("{name}, rows: {count}", name=title, count=len(next(iter(numbers.values()))))
        )
        if (errors := part.errors) is not None:
            numbers["error_nm"] = errors[1]
            link_button(
                text("Compare its errors with calibrations"), compared_address([self._run_id])
            )
        first = _worth_seeing(numbers)
        if first:
            self._plot(numbers, first)
        side: Side = next((side for side in SIDES if side in f"{part.stream} {kind}"), "")
        figures = [
            column_figures(name, values[:SHOWN_ROWS], side) for name, values in numbers.items()
        ]
        headings = [(column_with_unit(text, name), True) for name in numbers]
        table(title, headings, list(zip(*figures, strict=True)))
        if (count := len(next(iter(numbers.values())))) > SHOWN_ROWS:
            words(
                "p",
                text("… {shown} of {all} rows; the export has all.", shown=SHOWN_ROWS, all=count),
                "muted small",
            )

    def _plot(self, numbers: dict[str, Sequence[Any]], first: str) -> None:
        text = self._text
        names = list(numbers)
        state = {
            "x": "standard_nm" if "standard_nm" in names else names[0],
            "y": first,
        }

        def choose(axis: str, name: str) -> None:
            state[axis] = name
            draw()

        with box("div", "columns"):
            for axis, title in (("x", text("Horizontal")), ("y", text("Vertical"))):
                Field(
                    title,
                    state[axis],
                    options={name: column_with_unit(text, name) for name in names},
                    on_change=partial(choose, axis),
                )
        place = box("div")

        def draw() -> None:
            x, y = state["x"], state["y"]
            with refilled(place):
                Chart(
                    text("{y} over {x}.", x=column_title(text, x), y=column_title(text, y)),
                    column_with_unit(text, x),
                    column_with_unit(text, y),
                    [Line(column_title(text, y), numbers[x], numbers[y], COLOURS[0], points=True)],
                )

        draw()

    async def _export(self, operation: str, name: str) -> None:
        """Export the run beside the event loop, and download the file."""
        visitor = self._visitor
        request = {"run": self._run_id, "out": name}
        perform = partial(visitor.service.perform, visitor.actor, operation, request)
        result = await visitor.attempt_aside(perform)
        for reference in () if result is None else result.files:
            download(visitor, reference)

    async def _export_data(self, chosen: str) -> None:
        """Download the samples as one file."""
        from torquebench.records.export.streams import STREAM_FORMATS, stream_ending

        file_format = next((name for name in STREAM_FORMATS if name == chosen), None)
        if file_format is not None:
            name = f"{self._run_id}-samples{stream_ending(file_format)}"
            await self._export("records export-data", name)


def _worth_seeing(numbers: Mapping[str, Sequence[Any]]) -> str:
    """Return the initially plotted column: a measured one whose values vary; empty without one."""
    varying = [
        name
        for name, values in numbers.items()
        if len(set(values)) > 1 and column_unit_shown(name) not in ("", "s")
    ]
    return next((name for name in (*Y_FIRST, *varying) if name in varying), "")


@page("run", "/runs/{run_id}")
def run_page(visitor: Visitor) -> None:
    """Build the page of a run."""
    run_id = visitor.query["run_id"]
    with frame(visitor, "records", title=run_id):
        place = box("div", "stack")
        with place:
            words("p", visitor.text("Reading the records …"), "muted", role="status")
        ui.timer(0.0, partial(_RunPanel(visitor, run_id).build, place), once=True)
