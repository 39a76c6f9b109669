"""The pages of the panel: each registers itself with its path, icon and place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torquebench.panel.pages.visitor import Visitor

__all__ = ["PAGES", "Page", "page"]

Build = Callable[[Visitor], None]


@dataclass(frozen=True)
class Page:
    """One page.

    Attributes
    ----------
    name : str
        Its title is the text `navigation.NAME`.
    path : str
        Parts in braces, such as ``/calibrations/{number}``, are in the visitor's query.
    picture : str
        Icon in the navigation rail.
    place : int
        Place in the rail; Alt and this number open the page. 0: it isn't in the rail.
    build : callable
        Fills the page for a visitor.
    """

    name: str
    path: str
    picture: str
    place: int
    build: Build


PAGES: dict[str, Page] = {}
"""All pages by name; complete as soon as the package `pages` is imported."""


def page(name: str, path: str, picture: str = "", place: int = 0) -> Callable[[Build], Build]:
    """Register the function that builds a page."""

    def enter(build: Build) -> Build:
        PAGES[name] = Page(name, path, picture, place, build)
        return build

    return enter
