"""Where an operation works: on an open bench, on records, or on files only."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records.signatures import Signature

if TYPE_CHECKING:
    from torquebench.bench.mounting_record import MountingRecord
    from torquebench.calibration import Profile
    from torquebench.campaign.measuring import OnPause, RunOptions
    from torquebench.procedures.turning.profile import TurningProfile
    from torquebench.records import Registry
    from torquebench.reducers import ReducerDescription
    from torquebench.station import Station


REGISTRY_URL = "TORQUEBENCH_REGISTRY"
"""Environment variable with the URL of a registry server; see `records.REGISTRY_URL`."""
REGISTRY_FILE = "registry.sqlite"
"""Registry file in a data directory; see `records.REGISTRY_FILE`."""

Role = Literal["operator", "metrologist", "administrator"]
ROLES: tuple[Role, ...] = ("operator", "metrologist", "administrator")
"""Each role includes the permissions of the roles before it."""


def allows(role: Role, wanted: Role) -> bool:
    """Return whether a role includes another role.

    Examples
    --------
    >>> allows("administrator", "metrologist"), allows("operator", "metrologist")
    (True, False)
    """
    return ROLES.index(role) >= ROLES.index(wanted)


Value = TypeVar("Value")


class Library(Protocol):
    """Profiles and reducers by name."""

    def turning(self, name: str) -> TurningProfile:
        """Return a turning profile by name; raises InputError if it doesn't exist."""

    def profile(self, name: str) -> Profile:
        """Return a profile by name; raises InputError if it doesn't exist."""

    def reducer(self, name: str) -> ReducerDescription:
        """Return a reducer's description by name; raises InputError if it doesn't exist."""


class PackagedLibrary:
    """Profiles and reducers of the package by name, and others by the path of their file."""

    def profile(self, name: str) -> Profile:
        """Return a profile by its name or the path of its file."""
        from torquebench.calibration import load_profile

        return load_profile(name)

    def turning(self, name: str) -> TurningProfile:
        """Return a turning profile by its name or the path of its file."""
        from torquebench.procedures.turning.profile import load_turning_profile

        return load_turning_profile(name)

    def reducer(self, name: str) -> ReducerDescription:
        """Return a reducer's description by its name or the path of its file."""
        from torquebench.reducers import load_reducer

        return load_reducer(name)


def compute_here(
    function: Callable[..., Value], *arguments: Any, progress: Progress = NO_PROGRESS
) -> Value:
    """Call a function in this process, with the progress as its last argument."""
    return function(*arguments, progress)


@dataclass(frozen=True)
class Place:
    """Everything that an operation works with.

    Parameters
    ----------
    operator : str
        Person who requested it, for the records.
    library : Library
    registry : Registry
        The registry; None for operations on files.
    station : Station
        The open bench; None for operations without it.
    folder : pathlib.Path
        The data directory, even if its registry can't be opened.
    signature : Signature
        How the person was authenticated; typed on this computer by default.
    on_pause : callable, optional
        Decides whether a paused run continues; see `Station.run`.
    compute : callable
        Calls a long computation with its arguments and `progress`, possibly in another process.
    remarks : list of str
        Remarks so far; they are reported even if the operation fails.
    finishing : threading.Event
        Set when a person wants the operation to end and return its result.
    cancelled : callable
        Returns who or what has aborted the operation; empty while it goes on.
    may : callable
        Returns whether the person has a role.
    people : callable
        Returns the names of people with an account, who belong to the laboratory.
    """

    operator: str
    library: Library
    registry: Registry = None  # type: ignore[assignment]  # only operations on files have none
    station: Station = None  # type: ignore[assignment]  # only operations on the bench use it
    folder: Path = Path()
    signature: Signature = field(default_factory=Signature.typed)
    on_pause: OnPause | None = None
    compute: Callable[..., Any] = compute_here
    remarks: list[str] = field(default_factory=list)
    finishing: Event = field(default_factory=Event)
    cancelled: Callable[[], str] = str
    may: Callable[[Role], bool] = lambda _role: True
    people: Callable[[], Iterable[str]] = tuple

    def check(self) -> None:
        """Raise `EndedError` if an abort was requested."""
        if reason := self.cancelled():
            raise EndedError(reason)

    def run_options(
        self,
        progress: Progress,
        mounting: MountingRecord | None = None,
        metadata: Mapping[str, Any] | None = None,
    ) -> RunOptions:
        """Return the options of a run on the bench."""
        return {
            "operator": self.operator,
            "mounting": mounting,
            "metadata": {"signature": self.signature, **(metadata or {})},
            "progress": progress,
            "on_pause": self.on_pause,
        }


def data_directory(path: Path) -> Path:
    """Return a data directory, checked to have a registry in it or on the named server.

    Raises
    ------
    InputError
        Where there is no registry.
    """
    if not has_registry(path):
        from torquebench.records.registry.database import WAY_BACK, lost_registry

        if lost := lost_registry(path):
            raise InputError(
                Message("the registry of {path} {lost}", path, lost),
                "a registry that lists these runs",
                WAY_BACK,
            )
        raise InputError(
            Message("no records in {path}", path),
            "a data directory of torquebench",
            "name it with --data, or run `torquebench demo` or `torquebench calibrate` first",
        )
    return path


def has_registry(path: Path) -> bool:
    """Return whether a registry exists in this data directory or is named on a server."""
    return bool(os.environ.get(REGISTRY_URL)) or (path / REGISTRY_FILE).is_file()


class EndedError(BenchError):
    """A person has aborted the operation."""
