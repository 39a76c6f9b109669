"""Plain HTML elements, which browsers and screen readers support natively."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Coroutine, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, date, datetime
from inspect import iscoroutine
from typing import Any, ParamSpec, TypeVar

from nicegui import context, run, ui
from nicegui.elements.mixins.text_element import TextElement

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")

NOTE_ICONS = {"good": "check_circle", "warn": "warning", "bad": "error", "": "info"}


class Words(TextElement):
    """An element with text, which `set_text` can change."""

    def __init__(self, tag: str, text: str) -> None:
        super().__init__(tag=tag, text=text)


def _dress(element: Any, classes: str, attributes: Mapping[str, Any]) -> Any:
    if classes:
        element.classes(classes)
    for name, value in attributes.items():
        if value is not None and value is not False:
            key = name.rstrip("_").replace("_", "-")
            element.props[key] = value
    return element


def box(tag: str = "div", classes: str = "", **attributes: Any) -> Any:
    """Add a container element; underscores in attribute names become hyphens."""
    return _dress(ui.element(tag), classes, attributes)


async def in_thread(
    function: Callable[Arguments, Value], *arguments: Arguments.args, **options: Arguments.kwargs
) -> Value:
    """Call a function on another thread; if the panel ends meanwhile, cancel the caller's task."""
    done: tuple[Value] | None = await run.io_bound(lambda: (function(*arguments, **options),))
    if done is None:  # NiceGUI returns None when it shuts down
        raise asyncio.CancelledError
    return done[0]


@contextmanager
def refilled(place: Any) -> Iterator[Any]:
    """Empty an element and enter it, to fill it again."""
    place.clear()
    with place:
        yield place


def words(tag: str, text: str, classes: str = "", **attributes: Any) -> Any:
    """Add an element with text."""
    return _dress(Words(tag, text), classes, attributes)


def moment(at: date, *, seconds: bool = False) -> Any:
    """Add a time or a day, which the browser shows in the reader's zone and format (`panel.js`)."""
    if not isinstance(at, datetime):
        return words("time", at.isoformat(), "number", datetime=at.isoformat())
    utc = at.astimezone(UTC)
    said = f"{utc:%Y-%m-%d %H:%M:%S}" if seconds else f"{utc:%Y-%m-%d %H:%M}"
    stamp = f"{utc:%Y-%m-%dT%H:%M:%SZ}"
    made = words("time", f"{said} UTC", "number", datetime=stamp)
    if seconds:
        made.props["data-seconds"] = "1"
    return made


def dated(sentence: str, at: date) -> None:
    """Add a sentence in which `#` stands for a time or a day."""
    before, after = sentence.split("#")
    with box("p"):
        words("span", before)
        moment(at)
        words("span", after)


def on_press(element: Any, action: Callable[[], Any]) -> None:
    """Run an action when an element is pressed, and report its end to the browser.

    The browser acknowledges the press at once, refuses presses while disconnected, and reports a
    missing response (`panel.js`).
    """

    def tell(what: str) -> None:
        element.client.run_javascript(f'torquebench.{what}("{element.html_id}")')

    async def finish(work: Coroutine[Any, Any, Any]) -> None:
        with element.client.content:
            try:
                tell("heard")
                await work
            finally:
                tell("done")

    def pressed() -> Coroutine[Any, Any, None] | None:
        work = None
        try:
            with element.client.content:  # the button may be removed before the action ends
                work = action()
        finally:
            if not iscoroutine(work):
                tell("done")
        return finish(work) if iscoroutine(work) else None

    element.props["data-press"] = "1"
    element.on("click", pressed, [])


def icon(name: str) -> Any:
    """Add a decorative icon beside text with the same meaning."""
    return _dress(ui.icon(name), "", {"aria_hidden": "true"})


def panel(title: str = "", classes: str = "", *, level: int = 2) -> Any:
    """Add a framed part of a page with a heading."""
    frame = box("section", f"panel {classes}".strip(), aria_label=title or None)
    if title:
        with frame:
            words(f"h{level}", title)
    return frame


def tag(text: str, kind: str = "", picture: str = "") -> Any:
    """Add a short label of a state; `kind` is "good", "warn", "bad" or empty."""
    frame = box("span", f"tag {kind}".strip())
    with frame:
        if picture:
            icon(picture)
        words("span", text)
    return frame


def note(text: str, kind: str = "", *, title: str = "", live: bool = False) -> Any:
    """Add a remark; screen readers read a live one when it appears."""
    role = "alert" if live and kind == "bad" else "status" if live else None
    frame = box("div", f"note {kind}".strip(), role=role)
    with frame:
        icon(NOTE_ICONS[kind])
        with box("div"):
            if title:
                words("h3", title)
            words("p", text)
    return frame


def empty(text: str, picture: str = "inbox") -> Any:
    """Add a hint that a list is empty, and how to fill it."""
    frame = box("div", "empty")
    with frame:
        icon(picture)
        words("p", text)
    return frame


def pairs(items: Iterable[tuple[str, str | date]]) -> Any:
    """Add a list of names and values."""
    frame = box("dl", "pairs")
    with frame:
        for name, value in items:
            words("dt", name)
            if isinstance(value, date):
                with box("dd"):
                    moment(value, seconds=True)
            else:
                words("dd", value, "number")
    return frame


def repeat(interval_s: float, action: Callable[[], Any]) -> None:
    """Call a function repeatedly while the page is connected.

    Without a connection the server still keeps the page for a while.
    """
    client = context.client
    ui.timer(interval_s, lambda: action() if client.has_socket_connection else None)


def to_the_top() -> None:
    """Scroll the page to its top, where a part was opened."""
    ui.run_javascript("window.scrollTo(0, 0)")


def scrolling(label: str) -> Any:
    """Add a frame for wide content that can be scrolled by keyboard."""
    return box("div", "scroll", tabindex="0", role="region", aria_label=label)


def headings(
    text: Callable[[str], str], *titles: str, numbers: Collection[str] = ()
) -> list[tuple[str, bool]]:
    """Return a table's columns in the visitor's language, and whether they contain numbers.

    Parameters
    ----------
    text : callable
        Texts in the visitor's language.
    *titles : str
        Headings in English.
    numbers : collection of str
        Those of the columns with numbers.
    """
    return [(text(title), title in numbers) for title in titles]


def table(
    caption: str,
    columns: Sequence[tuple[str, bool]],
    rows: Sequence[Sequence[str | date]],
    *,
    best: int | None = None,
    on_row: Callable[[int], Any] | None = None,
    open_label: str = "",
    selected: Iterable[int] = (),
) -> Any:
    """Add a table.

    Parameters
    ----------
    caption : str
    columns : sequence of (str, bool)
        Heading, and whether the column contains numbers.
    rows : sequence of sequence of str, datetime.datetime or datetime.date
    best : int, optional
        Row to emphasise.
    on_row : callable, optional
        Called with the index of a row when its button is pressed.
    open_label : str
        Label of that button.
    selected : iterable of int
        Indices of the selected rows.
    """
    chosen = set(selected)
    frame = scrolling(caption)
    with frame, box("table", "data"):
        words("caption", caption, "hidden-visually")
        with box("thead"), box("tr"):
            for heading, numbers in columns:
                words("th", heading, "number" if numbers else "", scope="col")
            if on_row is not None:
                with box("th", scope="col"):
                    words("span", open_label, "hidden-visually")
        with box("tbody"):
            for place, row in enumerate(rows):
                with box("tr", "best" if place == best else "") as line:
                    if place in chosen:
                        line.props["aria-selected"] = "true"
                    for (heading, numbers), value in zip(columns, row, strict=True):
                        kind = "number" if numbers else ""
                        if isinstance(value, date):
                            with box("td", kind, data_heading=heading):
                                moment(value)
                        else:
                            words("td", value, kind, data_heading=heading)
                    if on_row is not None:
                        _row_button(open_label, _named(row[0]), place, on_row)
    return frame


def _named(value: str | date) -> str:
    """Return a row's first value as text for a button's label."""
    if isinstance(value, datetime):
        return f"{value.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"
    return str(value)


def _row_button(label: str, name: str, place: int, on_row: Callable[[int], Any]) -> None:
    with box("td"):
        button = words(
            "button", label, "control small", type="button", aria_label=f"{label}: {name}"
        )
        on_press(button, lambda: on_row(place))
