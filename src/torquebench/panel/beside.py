"""Services beside the panel: a protocol by which other programs use the same open bench."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torquebench.panel.service import BenchService

__all__ = ["PanelService"]


@dataclass(frozen=True)
class PanelService:
    """A service that an option of `torquebench panel` starts.

    An installed package names it by an entry point in the group ``torquebench.services``.

    Attributes
    ----------
    option : str
        Name of the option, without its dashes.
    value : str
        What stands for the option's value in the help, such as ``URL``.
    help : str
        The option's help, a sentence.
    settings : callable
        Returns the settings of the option's value. It is called before the bench opens, and raises
        `InputError` where the service couldn't start.
    serve : callable
        Takes the open bench, the settings and a function that prints a note at any time; returns a
        context manager. The service runs while it is entered; the panel is served meanwhile. It
        gives the address that is printed beside the panel's, or None.
    """

    option: str
    value: str
    help: str
    settings: Callable[[str], Any]
    serve: Callable[[BenchService, Any, Callable[[str], None]], AbstractContextManager[str | None]]
