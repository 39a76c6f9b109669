"""Progress of long work: one interface for plans, fits, files and campaigns."""

from __future__ import annotations

from typing import Protocol

from torquebench.message import Message

__all__ = ["NO_PROGRESS", "SHARES", "NoProgress", "Part", "Progress"]

SHARES = 100
"""Number of steps of work that only reports its completed share, such as a fit."""


class Progress(Protocol):
    """Display for the stages of work: a bar in the terminal, a job of the panel, or none."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps (None if unknown); the previous stage ends."""

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of completed steps, and the present step."""

    def finish(self, detail: str = "") -> None:
        """End the stage, with a short text about its result."""


class NoProgress:
    """Progress without a display."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage."""

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of completed steps."""

    def finish(self, detail: str = "") -> None:
        """End the stage."""


NO_PROGRESS: Progress = NoProgress()


class Part(NoProgress):
    """A part of a stage, which counts its own steps from zero.

    Parameters
    ----------
    progress : Progress
        Progress of the whole stage.
    first : int
        Number of steps of the stage before this part.
    prefix : str
        Text before each detail, followed by a comma.
    share : float
        Steps of the stage for each step of the part.
    """

    def __init__(
        self, progress: Progress, first: float, *, prefix: str = "", share: float = 1.0
    ) -> None:
        self._progress, self._first = progress, first
        self._prefix, self._share = prefix, share

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of completed steps of this part."""
        parts = (part for part in (self._prefix, detail) if part)
        self._progress.reach(round(self._first + self._share * done), Message.joined(parts))
