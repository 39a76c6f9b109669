"""Interface for services with other protocols, such as OPC UA, for the panel's open bench."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from torquebench.bench import BenchDescription
    from torquebench.operations import Role
    from torquebench.panel.service import (
        Actor,
        AlarmView,
        BenchSnapshot,
        JobView,
        RecordQueries,
    )

__all__ = ["Jobs", "PanelService", "ServedBench"]


class Jobs(Protocol):
    """The jobs of a bench, of which at most one is running."""

    @property
    def current(self) -> JobView | None:
        """The running job; None without one."""

    def recent(self) -> list[JobView]:
        """Return jobs since the panel was started, the newest first."""


class ServedBench(Protocol):
    """The panel's open bench, as an additional service sees it.

    Every method may be called from any thread, returns frozen values, and raises `TorquebenchError`
    to refuse a call. Nothing here moves the bench.
    """

    @property
    def description(self) -> BenchDescription:
        """Description of the bench."""

    @property
    def data_dir(self) -> Path:
        """Data directory, in which a service may also store its files."""

    @property
    def records(self) -> RecordQueries:
        """Runs, calibrations, certificates and their files; keep no reference to this object."""

    @property
    def jobs(self) -> Jobs:
        """Running and recent jobs."""

    def snapshot(self) -> BenchSnapshot:
        """Return state and live values of both sides; fast enough to be called every 0.1 s."""

    def alarms(self, *, active: bool = False) -> list[AlarmView]:
        """Return alarms and warnings, newest first; or only active ones, most severe first."""

    def identify(self, name: str, secret: str, address: str) -> Actor:
        """Return a person by name and password, or a program by its name and token.

        Raises
        ------
        TorquebenchError
            Name and secret don't match, or too many attempts failed.
        """

    def present(self, actor: Actor, role: Role | None = None) -> Actor | None:
        """Return an actor with its present role; None if it no longer has access or this role."""

    def acknowledge(
        self, actor: Actor, alarm_ids: Collection[str] | None = None
    ) -> AlarmView | None:
        """Acknowledge the latched alarm after its cause is removed; return it."""

    def note(self, actor: Actor, what: str, **details: Any) -> None:
        """Enter an action into the panel's log and the bench's audit log."""


@dataclass(frozen=True)
class PanelService:
    """A service that an option of `torquebench panel` starts.

    An installed package provides it as an entry point in the group ``torquebench.services``.

    Attributes
    ----------
    option : str
        Name of the option, without its dashes.
    value : str
        Placeholder of the option's value in the help, such as ``URL``.
    help : str
        The option's help, one sentence.
    settings : callable
        Converts the option's value to settings. It is called before the bench opens, and raises
        `InputError` if the service couldn't start.
    serve : callable
        Takes the open bench, the settings and a function that prints a note; returns a context
        manager. The service runs within its block, as long as the panel is served. It yields the
        address to print beside the panel's address, or None.
    """

    option: str
    value: str
    help: str
    settings: Callable[[str], Any]
    serve: Callable[[ServedBench, Any, Callable[[str], None]], AbstractContextManager[str | None]]
