"""A part of a page, such as the content of a tab."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial

from nicegui import ui

from torquebench.errors import TorquebenchError
from torquebench.panel.components.elements import note
from torquebench.panel.components.tabs import Tabs
from torquebench.panel.pages.page import PAGES
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import NotSignedInError
from torquebench.panel.text import Text, Texts

LOGGER = logging.getLogger(__name__)


@contextmanager
def part(text: Text) -> Iterator[None]:
    """If building a part of a page fails, show the error there, so that the rest works."""
    try:
        yield
    except NotSignedInError:  # the page redirects to sign-in
        raise
    except TorquebenchError as error:
        note(text.refusal_line(error), "bad", live=True)
    except Exception as error:
        LOGGER.exception("a part of a page failed")
        problem = f"{type(error).__name__}: {error}"
        note(text("This part can't be shown: {problem}", problem=problem), "bad", live=True)


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


def tabs(
    visitor: Visitor, page: str, titles: Texts, views: Mapping[str, Callable[[Visitor], View]]
) -> None:
    """Add the tabs of a page; the part of its address names the initial and the present one."""
    parts = {name: partial(_build, view, visitor) for name, view in views.items()}
    path = visitor.address.partition("?")[0]
    Tabs(
        visitor.text(PAGES[page].title),
        {name: visitor.text(titles[name]) for name in views},
        parts,
        visitor.query.get("part", ""),
        lambda name: ui.navigate.history.replace(f"{path}?part={name}"),
    )


def _build(view: Callable[[Visitor], View], visitor: Visitor) -> None:
    with part(visitor.text):
        view(visitor).build()
