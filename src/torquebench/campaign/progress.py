"""How a campaign tells its watcher where it is, without knowing who watches."""

from __future__ import annotations

from typing import Protocol

__all__ = ["NO_PROGRESS", "NoProgress", "Progress"]


class Progress(Protocol):
    """A watcher of stages: a progress bar in the terminal, a panel, or nobody."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps (None where nobody can tell); ends the stage before."""

    def advance(self, steps: int = 1, detail: str = "") -> None:
        """Count finished steps and say what is at work."""

    def finish(self, detail: str = "") -> None:
        """End the stage, with what came out of it in a few words."""


class NoProgress:
    """Nobody watches."""

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage."""

    def advance(self, steps: int = 1, detail: str = "") -> None:
        """Count finished steps."""

    def finish(self, detail: str = "") -> None:
        """End the stage."""


NO_PROGRESS: Progress = NoProgress()
