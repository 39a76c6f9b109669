"""The panel's pages, in NiceGUI."""

from __future__ import annotations

from nicegui import ui

from torquebench.panel.service import BenchService

__all__ = ["register_pages"]


def register_pages(service: BenchService) -> None:
    """Add every page to NiceGUI's application."""

    @ui.page("/")
    def live() -> None:
        torque = ui.label()

        def paint() -> None:
            side = service.snapshot().sides["output"]
            torque.text = f"{side.torque.value} N·m"

        ui.timer(0.1, paint)
