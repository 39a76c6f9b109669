"""Progress of long work: one protocol for plans, fits, files and campaigns."""

from __future__ import annotations

from typing import Protocol

from torquebench.message import Message

__all__ = ["NO_PROGRESS", "SHARES", "NoProgress", "Part", "Progress"]

SHARES = 100
"""Steps of work that only reports its share, such as a fit."""


class Progress(Protocol):
    """Display of the stages of work: a bar in the terminal, a job of the panel, or none."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps (None if it is unknown); ends the stage before."""

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of finished steps and the present one."""

    def finish(self, detail: str = "") -> None:
        """End the stage, with its result in a few words."""


class NoProgress:
    """Nobody watches."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage."""

    def reach(self, done: int, detail: str = "") -> None:
        """Say how many steps are done."""

    def finish(self, detail: str = "") -> None:
        """End the stage."""


NO_PROGRESS: Progress = NoProgress()


class Part(NoProgress):
    """A part of a stage, whose work counts its own steps from zero.

    Parameters
    ----------
    progress : Progress
        Of the whole stage.
    first : int
        Steps of the stage before this part.
    prefix : str
        Put before each detail, with a comma.
    share : float
        Steps of the stage to one step of the part.
    """

    def __init__(
        self, progress: Progress, first: float, *, prefix: str = "", share: float = 1.0
    ) -> None:
        self._progress, self._first = progress, first
        self._prefix, self._share = prefix, share

    def reach(self, done: int, detail: str = "") -> None:
        """Say how many steps of this part are done."""
        parts = (part for part in (self._prefix, detail) if part)
        self._progress.reach(round(self._first + self._share * done), Message.joined(parts))
