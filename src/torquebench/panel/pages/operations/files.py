"""Fields for files of operations, and buttons for the files that operations have written."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import ui

from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.elements import box, refilled, words
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service.files import LARGEST_FILE

SEND = (
    "async (event) => { let number = 0; for (const file of event.target.files) {"
    f" if (file.size > {LARGEST_FILE}) {{ emit([number++, file.name, null]); continue; }}"
    " const bytes = new Uint8Array(await file.arrayBuffer()); let text = '';"
    " for (let at = 0; at < bytes.length; at += 8192)"
    " text += String.fromCharCode(...bytes.subarray(at, at + 8192));"
    " emit([number++, file.name, btoa(text)]); } }"
)
"""Script that sends number, name and bytes of each file, or no bytes if the file is too large."""


class FileField(Field):
    """A field whose value is the reference of a file, or several, separated by commas.

    Parameters
    ----------
    visitor : Visitor
    label, value, hint : str
    several : bool
        Whether it takes several files.
    typed : bool
        Whether a text may be typed instead.
    on_change : callable
    """

    def __init__(
        self,
        visitor: Visitor,
        label: str,
        value: str,
        hint: str,
        *,
        several: bool,
        typed: bool,
        on_change: Callable[[str], Any],
    ) -> None:
        self._visitor, self._several = visitor, several
        super().__init__(label, value, hint=hint, on_change=on_change, autocomplete="off")
        self.control.set_visibility(typed)
        with self.frame:
            entry = box("input", "control", type="file", multiple=several)
            entry.props["aria-label"] = label
            entry.on("change", self._chosen, js_handler=SEND)
            self._names = box("div", "small muted")
        self._show()

    def _chosen(self, event: Any) -> None:
        number, name, content = event.args
        try:
            raw = b" " * (LARGEST_FILE + 1) if content is None else base64.b64decode(content)
            reference = self._visitor.service.files.add(raw, str(name))
        except TorquebenchError as error:
            self.set("")
            self.wrong(f"{name}: {self._visitor.text(error.allowed)}")
            return
        except (binascii.Error, ValueError):
            self.wrong(self._visitor.text("The file couldn't be read."))
            return
        self.set(f"{self.value}, {reference}" if self._several and number else reference)
        self.wrong("")
        self._show()
        if self._on_change is not None:
            self._on_change(self.value)

    def _show(self) -> None:
        with refilled(self._names):
            if "/" in self.value:
                names = [each.partition("/")[2] for each in self.value.split(",")]
                words("span", ", ".join(names))


def download(visitor: Visitor, reference: str) -> None:
    """Download a file that an operation has written."""
    path = visitor.service.files.path(reference)
    ui.download(path.read_bytes(), path.name)


def file_buttons(visitor: Visitor, files: Sequence[str]) -> None:
    """Add a download button for each file that an operation has written and that is still kept."""
    if kept := [each for each in files if visitor.service.files.has(each)]:
        with box("div", "line"):
            for each in kept:
                name = each.partition("/")[2]
                action = partial(visitor.attempt, partial(download, visitor, each))
                label = visitor.text("Download {name}", name=name)
                button(label, action, picture="download")
