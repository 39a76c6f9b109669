"""The certificate as it would be issued, page by page, before it is signed."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any

from nicegui import run

from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box
from torquebench.panel.pages.calibrate.page import CalibratePage
from torquebench.panel.pages.jobs.panel import problem_note

__all__ = ["CertificatePreview"]


class CertificatePreview:
    """A button, and below it the pages of a draft.

    Parameters
    ----------
    page : CalibratePage
    asked : callable
        Returns the chosen languages, tolerance and model.
    """

    def __init__(self, page: CalibratePage, asked: Callable[[], Mapping[str, Any] | None]) -> None:
        self._page, self._asked = page, asked

    def build(self) -> None:
        """Make the button."""
        with box("div", "line"):
            button(self._page.text("certificate.preview"), self._show, picture="preview")
        self._place = box("div", "stack")

    async def _show(self) -> None:
        """Open the dialog with the draft's pages."""
        text, service = self._page.text, self._page.visitor.service
        number = self._page.workflow.calibration_id
        assert number is not None
        self._place.clear()
        asked = self._asked()
        if asked is None:
            return
        try:
            pages = await run.io_bound(service.certificate_preview, number, **asked)
        except TorquebenchError as error:
            with self._place:
                problem_note(text, error)
            return
        with self._place, box("div", "certificate-pages"):
            for place, content in enumerate(pages, start=1):
                data = base64.b64encode(content).decode()
                label = text("certificate.page", number=place, of=len(pages))
                box("img", src=f"data:image/png;base64,{data}", alt=label)
