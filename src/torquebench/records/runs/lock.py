"""Locks on run folders during writing; a lock ends with its process."""

from __future__ import annotations

import os
import sys
from pathlib import Path

LOCKED_FILE = "run.json"
"""The file in a run's folder that is locked; it exists from the start and never changes."""


class RunLock:
    """Locks a run's folder for this process; the operating system releases the lock when it ends.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._file: int | None = os.open(folder / LOCKED_FILE, os.O_RDONLY)
        if not _lock(self._file):
            self.release()

    @property
    def held(self) -> bool:
        """Whether this process has the lock; otherwise another process has it."""
        return self._file is not None

    def release(self) -> None:
        """Release the lock. A second call does nothing."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


if sys.platform == "win32":  # pragma: no cover - files that are being written can't be sealed there

    def _lock(_file: int) -> bool:
        return True

else:
    import fcntl

    def _lock(file: int) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True


def is_held(folder: Path) -> bool:
    """Return whether a process writes a run's folder right now."""
    try:
        hold = RunLock(folder)
    except OSError:  # no folder to lock
        return False
    try:
        return not hold.held
    finally:
        hold.release()
