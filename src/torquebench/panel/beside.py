"""Services beside the panel: other protocols for the bench that the panel has open."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from torquebench.bench import BenchDescription
    from torquebench.panel.service import (
        Actor,
        AlarmView,
        BenchSnapshot,
        JobView,
        RecordQueries,
        Role,
    )

__all__ = ["Jobs", "PanelService", "ServedBench"]


class Jobs(Protocol):
    """The jobs of a bench: at most one is under way."""

    @property
    def current(self) -> JobView | None:
        """The job under way."""

    def recent(self) -> list[JobView]:
        """Return jobs since the panel was started, the newest first."""


class ServedBench(Protocol):
    """The open bench of a panel, as a service beside it uses it.

    Every method may be called from any thread, returns frozen values, and raises
    `TorquebenchError` where it refuses. Nothing here moves the bench.
    """

    @property
    def description(self) -> BenchDescription:
        """Description of the bench."""

    @property
    def data_dir(self) -> Path:
        """Data directory; a service keeps its own files there."""

    @property
    def records(self) -> RecordQueries:
        """Runs, calibrations, certificates and their files; ask again after each use."""

    @property
    def jobs(self) -> Jobs:
        """The jobs."""

    def snapshot(self) -> BenchSnapshot:
        """Return state and live values of both sides; cheap enough for every 0.1 s."""

    def alarms(self, *, active: bool = False) -> list[AlarmView]:
        """Return alarms and warnings, the newest first; active ones alone, the worst first."""

    def identify(self, name: str, secret: str, address: str) -> Actor:
        """Return a person by name and password, or a program by its name and token.

        Raises
        ------
        TorquebenchError
            It is neither, or is locked out for a while.
        """

    def present(self, actor: Actor, role: Role | None = None) -> Actor | None:
        """Return an actor with its present role; None if it lost its access or this role."""

    def acknowledge(
        self, actor: Actor, alarm_ids: Collection[str] | None = None
    ) -> AlarmView | None:
        """Clear the latched alarm by name, once its cause is gone; return the cleared alarm."""

    def note(self, actor: Actor, what: str, **details: Any) -> None:
        """Enter an action into the panel's log and the bench's audit log."""


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
    serve: Callable[[ServedBench, Any, Callable[[str], None]], AbstractContextManager[str | None]]
