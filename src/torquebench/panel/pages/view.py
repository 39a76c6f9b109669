"""A part of a page, such as the content of a tab."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from torquebench.panel.components.tabs import Tabs
from torquebench.panel.pages.visitor import Visitor

__all__ = ["View", "tabs"]


class View:
    """A part of a page; `build` makes its elements.

    Parameters
    ----------
    visitor : Visitor
    """

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text

    def build(self) -> None:
        """Make the elements of the part."""


def tabs(visitor: Visitor, page: str, views: Mapping[str, Callable[[Visitor], View]]) -> None:
    """Make the tabs of a page; the query parameter `part` names the first one shown."""
    titles = {name: visitor.text(f"{page}.{name}") for name in views}
    parts = {name: partial(_build, view, visitor) for name, view in views.items()}
    Tabs(visitor.text(f"{page}.title"), titles, parts, visitor.query.get("part", ""))


def _build(view: Callable[[Visitor], View], visitor: Visitor) -> None:
    view(visitor).build()
