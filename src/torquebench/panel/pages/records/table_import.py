"""The form for importing a calibration of another bench from a file, with a check before."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import Line, error_chart
from torquebench.panel.components.controls import Field, button, file_entry, typed_number
from torquebench.panel.components.elements import (
    box,
    headings,
    in_thread,
    note,
    pairs,
    panel,
    refilled,
    table,
    words,
)
from torquebench.panel.pages.jobs.panel import problem_note
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import TableView, read_table
from torquebench.panel.service.records.table_import import LONGEST_TABLE, states_reference
from torquebench.tables import endings

__all__ = ["TableEntry", "all_profile_titles", "profile_titles"]

READ_FILE = (
    "async (event) => { const file = event.target.files[0]; if (!file) return;"
    f" if (file.size > {LONGEST_TABLE}) {{ emit([file.name, null]); return; }}"
    " const bytes = new Uint8Array(await file.arrayBuffer()); let text = '';"
    " for (let at = 0; at < bytes.length; at += 8192)"
    " text += String.fromCharCode(...bytes.subarray(at, at + 8192));"
    " emit([file.name, btoa(text)]); }"
)
"""Script that sends a file's name and bytes, or only the name if the file is too large."""
LONGEST_NAME = 120
SHOWN_DEVIATIONS = 12
DAYS = ("reference_performed", "reference_due")
NEEDED = ("transducer_serial", "indicator", "measured_by", "reference_serial")
OPTIONAL = (
    "manufacturer", "transducer_model", "place", "reference_model", "reference_certificate",
    "reference_laboratory",
)  # fmt: skip


def all_profile_titles(visitor: Visitor) -> dict[str, str]:
    """Return the title of each profile by name."""
    return {
        item.name: visitor.text.core(str(item.document.get("title") or item.name))
        for item in visitor.service.settings.items("profiles")
    }


def profile_titles(visitor: Visitor, *, adaptive: bool = True) -> dict[str, str]:
    """Return titles of the profiles with steps by name, including the laboratory's own."""
    titles, offered = all_profile_titles(visitor), {}
    for item in visitor.service.settings.items("profiles"):
        document = item.document
        loading = document.get("loading") or {}
        if loading.get("pattern") == "random" or item.name == "check":
            continue
        if adaptive or not document.get("adaptive"):
            offered[item.name] = titles[item.name]
    return offered


def _moment(day: str) -> str:
    """Return noon of a past day, and the present time for today."""
    now = datetime.now(UTC)
    return now.isoformat() if day == now.date().isoformat() else f"{day}T12:00:00Z"


class TableEntry:
    """The form for a table: file, circumstances, findings, and import.

    Parameters
    ----------
    visitor : Visitor
    on_entered : callable
        Called with the calibration's number.
    """

    def __init__(self, visitor: Visitor, on_entered: Callable[[int], Any]) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._on_entered = on_entered
        self._content = ""
        self._called = "table.csv"
        self._fields: dict[str, Field] = {}

    def build(self) -> None:
        """Make the form's elements."""
        text = self._text
        with panel(text("external.title")), box("div", "stack"):
            words("p", text("external.explained"), "muted")
            with box("div", "field"):
                accepted = ",".join(endings())
                file_entry(text("external.file"), accepted, READ_FILE, self._chosen)
                words("div", text("external.file_hint"), "hint")
            with box("div", "columns"):
                profiles = profile_titles(self._visitor, adaptive=False)
                self._field("profile", next(iter(profiles)), options=profiles)
                today = datetime.now(UTC).date().isoformat()
                self._field("performed", today, kind="date", max=today)
                stated = {
                    way: text(f"external.stated_{way}")
                    for way in ("torque", "range", "points", "table")
                }
                self._field(
                    "reference_uncertainty_of", "torque", options=stated, on_change=self._stated
                )
                self._field("reference_uncertainty_percent", "0.02", unit="%", inputmode="decimal")
                self._field("reference_points", lines=True, hinted=True)
                self._stated("torque")
                self._field("resolution_nm", "0.01", unit="N·m", inputmode="decimal")
                self._field("range_nm", unit="N·m", inputmode="decimal", hinted=True)
                self._field("reference_performed", kind="date", max=today)
                self._field("reference_due", kind="date")
            with box("div", "line"):
                button(text("external.look"), self._look, "primary", picture="search")
            self._found = box("div", "stack")
            self._rest = box("div", "stack")
            with self._rest:
                words("h3", text("external.circumstances"))
                with box("div", "columns"):
                    for name in (*NEEDED, *OPTIONAL):
                        if name == "measured_by":
                            people = self._visitor.service.laboratory_people()
                            self._field(name, people[0], options={name: name for name in people})
                        else:
                            self._field(name, maxlength="120", autocomplete="off")
                with box("div", "line"):
                    button(text("external.enter"), self._enter, "primary", picture="save")
            self._rest.set_visibility(False)

    def _field(self, name: str, value: str = "", *, hinted: bool = False, **more: Any) -> None:
        hint = self._text(f"external.{name}_hint") if hinted else ""
        self._fields[name] = Field(self._text(f"external.{name}"), value, hint=hint, **more)

    def _stated(self, way: str) -> None:
        """Show the fields for one way of stating the standard's uncertainty."""
        for name in ("reference_uncertainty_percent", "reference_points"):
            asked = way != "table" and (name == "reference_points") == (way == "points")
            self._fields[name].frame.set_visibility(asked)

    def _points(self) -> dict[str, list[float]]:
        """Parse the typed table of a certificate; raises ValueError if it is invalid."""
        lines = self._fields["reference_points"].value.strip().splitlines()
        pairs = [
            [typed_number(cell) for cell in re.split(r"[;\s]+", line.strip())] for line in lines
        ]
        torque, expanded = zip(*pairs, strict=True)
        return {"torque_nm": list(torque), "expanded_uncertainty_nm": list(expanded)}

    def _reference(self) -> dict[str, Any] | None:
        """Return the entered uncertainty of the standard; None if it is invalid."""
        way = self._fields["reference_uncertainty_of"].value
        if way == "table":
            return {}
        name = "reference_points" if way == "points" else "reference_uncertainty_percent"
        field, wrong = self._fields[name], ""
        asked: dict[str, Any] | None = None
        try:
            if way == "points":
                asked = {name: self._points()}
            else:
                asked = {name: typed_number(field.value), "reference_uncertainty_of": way}
        except ValueError:
            wrong = "needed" if not field.value.strip() else "no_number"
        field.wrong(self._text(f"external.{wrong}") if wrong else "")
        return asked

    async def _chosen(self, sent: Any) -> None:
        """Receive the bytes of a file, whose name is only a label."""
        name, content = sent
        self._called = "".join(letter for letter in str(name) if letter.isprintable())[
            :LONGEST_NAME
        ]
        self._content = ""
        self._found.clear()
        self._rest.set_visibility(False)
        try:
            raw = b" " * (LONGEST_TABLE + 1) if content is None else base64.b64decode(content)
            self._content = await in_thread(read_table, raw, self._called)
            way = self._fields["reference_uncertainty_of"]
            if states_reference(self._content) or way.value == "table":
                way.set("table" if states_reference(self._content) else "torque")
                self._stated(way.value)
        except TorquebenchError as error:
            with self._found:
                problem_note(self._text, error)
        except (binascii.Error, ValueError):
            self._bad(self._text("external.unreadable"))

    def _bad(self, said: str) -> None:
        with refilled(self._found):
            note(said, "bad", live=True)

    def _request(self, *names: str) -> dict[str, Any] | None:
        """Return the entered values; None if a number is invalid."""
        numbers = ("resolution_nm", "range_nm")
        asked: dict[str, Any] = {"content": self._content}
        good = bool(self._content)
        if not good:
            self._bad(self._text("external.no_file"))
        for name in ("profile", "performed", *numbers, *DAYS, *names):
            field = self._fields[name]
            said = field.value.strip()
            wrong = ""
            if name in numbers and said:
                try:
                    asked[name] = typed_number(said)
                except ValueError:
                    wrong = self._text("external.no_number")
            elif said:
                asked[name] = _moment(said) if name == "performed" else said
            elif name in (*NEEDED, "performed", "resolution_nm"):
                wrong = self._text("external.needed")
            field.wrong(wrong)
            good = good and not wrong
        reference = self._reference()
        return asked | reference if good and reference is not None else None

    async def _look(self) -> None:
        asked = self._request()
        if asked is None:
            return
        self._found.clear()
        try:
            view = await in_thread(self._visitor.service.tables.preview, asked)
        except TorquebenchError as error:
            with self._found:
                problem_note(self._text, error)
            self._rest.set_visibility(False)
            return
        with self._found:
            self._show(view)
        self._rest.set_visibility(True)

    def _show(self, view: TableView) -> None:
        text = self._text
        pairs(
            [
                (text("preview.points"), str(view.points)),
                (text("external.range"), f"±{view.range_nm:g} N·m"),
                (
                    text("external.raw"),
                    f"{view.raw.worst_nm:.4g} N·m, {view.raw.worst_percent_fs:.3g} % FS",
                ),
            ]
        )
        if view.simulated:
            note(text("external.simulated"), "warn")
        for remark in view.remarks:
            note(text.core(remark), "warn")
        if view.deviations:
            kind = "warn" if view.certifiable else "bad"
            title = text("external.deviations" if view.certifiable else "external.not_certifiable")
            found = [text.core(deviation.found) for deviation in view.deviations]
            with note("", kind, title=title), box("ul"):
                for said in found[:SHOWN_DEVIATIONS]:
                    words("li", said)
                if len(found) > SHOWN_DEVIATIONS:
                    words("li", text("external.more", count=len(found) - SHOWN_DEVIATIONS))
        else:
            note(text("external.no_deviation"), "good")
        if view.directions:
            rows = [
                (
                    text.core(direction.name),
                    text.core("none") if direction.accuracy_class is None
                    else f"{direction.accuracy_class:g}",
                    f"{max(direction.uncertainty_percent):.3g}",
                )
                for direction in view.directions
            ]  # fmt: skip
            columns = headings(
                text, "external", "direction class largest_uncertainty", "class largest_uncertainty"
            )
            table(text("external.classes"), columns, rows)
        raw = text("live.line_raw")
        line = Line(raw, view.standard_nm, view.error_nm, "--series-raw", points=True)
        error_chart(text, "measure.errors_label", [line])

    async def _enter(self) -> None:
        asked = self._request(*NEEDED, *OPTIONAL)
        if asked is None:
            return
        asked["called"] = self._called or "table.csv"
        visitor = self._visitor
        enter = visitor.service.tables.enter
        entered = await visitor.attempt_aside(lambda: enter(visitor.actor, asked))
        if entered is not None:
            visitor.messages.good(self._text("external.entered", number=entered.calibration_id))
            self._on_entered(entered.calibration_id)
