"""Buttons for downloading a certificate's files."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box
from torquebench.panel.pages.visitor import Visitor


def certificate_buttons(visitor: Visitor, number: str, files: Sequence[str]) -> None:
    """Add a download button for each file of a certificate."""
    with box("div", "line"):
        for name in files:
            button(
                visitor.text("Download {name}", name=name),
                partial(_fetch, visitor, number, name),
                picture="download",
            )


def _fetch(visitor: Visitor, number: str, name: str) -> None:
    def fetch() -> None:
        content, media = visitor.service.records.certificate_file(number, name)
        ui.download(content, name, media)

    visitor.attempt(fetch)
