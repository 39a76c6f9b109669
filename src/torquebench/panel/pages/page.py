"""Registration of the panel's pages with path, icon and place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torquebench.panel.pages.visitor import Visitor

Build = Callable[[Visitor], None]


@dataclass(frozen=True)
class Page:
    """One page.

    Attributes
    ----------
    name : str
        Name of the page.
    path : str
        Path of the page; parts in braces, such as ``/calibrations/{number}``, are in the visitor's
        query.
    title : str
        Title in English; a page that is not in the rail has one of its own.
    picture : str
        Icon in the navigation rail.
    place : int
        Place in the navigation rail; Alt and this number open the page. 0 means not in the rail.
    build : callable
        Fills the page for a visitor.
    """

    name: str
    path: str
    title: str
    picture: str
    place: int
    build: Build


PAGES: dict[str, Page] = {}
"""All pages by name; complete after `import_pages`."""


def page(
    name: str, path: str, title: str = "", picture: str = "", place: int = 0
) -> Callable[[Build], Build]:
    """Register the function that builds a page."""

    def enter(build: Build) -> Build:
        PAGES[name] = Page(name, path, title, picture, place, build)
        return build

    return enter
