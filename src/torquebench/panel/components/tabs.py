"""Tabs: parts of a page, of which one is visible at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from torquebench.panel.components.elements import box, on_press, refilled, words


class Tabs:
    """Buttons for the parts, above the selected part, which is rebuilt when selected.

    Parameters
    ----------
    label : str
        Name of the group of parts.
    titles : mapping of name to title
    views : mapping of name to callable
        Functions that build a part.
    first : str
        The initial part; by default the first one.
    on_choice : callable, optional
        Called with the name of a part that the reader has chosen.
    """

    def __init__(
        self,
        label: str,
        titles: Mapping[str, str],
        views: Mapping[str, Callable[[], Any]],
        first: str = "",
        on_choice: Callable[[str], Any] = lambda _: None,
    ) -> None:
        self._views = views
        self._on_choice = on_choice
        self._buttons: dict[str, Any] = {}
        with box("div", "tabs", role="group", aria_label=label):
            for name, title in titles.items():
                made = words("button", title, "control", type="button", aria_pressed="false")
                on_press(made, partial(self._choose, name))
                self._buttons[name] = made
        self._content = box("div", "stack")
        self.show(first if first in titles else next(iter(titles)))

    def _choose(self, name: str) -> None:
        self.show(name)
        self._on_choice(name)

    def show(self, name: str) -> None:
        """Show one part."""
        for title, made in self._buttons.items():
            made.props["aria-pressed"] = "true" if title == name else "false"
            made.update()
        with refilled(self._content):
            self._views[name]()
