"""Enter runs into the registry from a queue, so that no measurement waits for a database."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from torquebench.errors import RecordError
from torquebench.records import Registry, RunFolder
from torquebench.station.entering import enter_run

RETRY_S = 0.5
SETTLE_S = 5.0
"""Longest time that the end of a run waits for a slow registry, s."""
CLOSE_S = 2.0


class RegistryQueue:
    """Enters runs into the registry on a separate thread, and retries until that succeeds.

    If the process ends before, the next start enters the runs from their folders.

    Parameters
    ----------
    on_trouble : callable
        Called with the error and the number of waiting runs when the registry begins to fail.
    on_caught_up : callable
        Called when all waiting runs were entered after a failure.
    """

    def __init__(
        self,
        registry: Registry,
        on_trouble: Callable[[str, int], None],
        on_caught_up: Callable[[], None],
    ) -> None:
        self._registry = registry
        self._on_trouble = on_trouble
        self._on_caught_up = on_caught_up
        self._waiting: dict[Path, None] = {}
        self._changed = threading.Condition()
        self._entering: Path | None = None
        self._failure: Exception | None = None
        self._behind = False
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="torquebench-registry", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of runs with entries still missing in the registry."""
        with self._changed:
            return len({*self._waiting, *([self._entering] if self._entering else [])})

    def enter(self, folder: Path) -> None:
        """Queue the missing entries of a run for the registry; returns at once."""
        with self._changed:
            self._waiting[folder] = None
            self._changed.notify_all()

    def settle(self) -> bool:
        """Wait until all runs are entered, but not for a failing registry.

        Returns
        -------
        bool
            Whether all runs are entered.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: not self.waiting or self._failure is not None, timeout=SETTLE_S
            )
            return not self.waiting

    def close(self) -> None:
        """Try to enter the waiting runs once more, and end the thread."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout=CLOSE_S if self._failure is not None else None)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                last = self._closing
                folders = list(self._waiting)
            for folder in folders:
                if not self._entered(folder):
                    break
            if last:
                return
            if self._failure is not None:
                self._pause()

    def _pause(self) -> None:
        """Wait before the next attempt, unless the bench is being closed."""
        deadline = time.monotonic() + RETRY_S
        with self._changed:
            while not self._closing and (left_s := deadline - time.monotonic()) > 0.0:
                self._changed.wait(left_s)

    def _entered(self, folder: Path) -> bool:
        """Try to enter one run; return whether that succeeded."""
        with self._changed:
            del self._waiting[folder]  # if the run ends meanwhile, it is queued again
            self._entering = folder
        failure: Exception | None = None
        try:
            enter_run(self._registry, RunFolder(folder))
        except (RecordError, OSError) as error:
            failure = error
        with self._changed:
            self._failure, self._entering = failure, None
            if failure is not None:
                self._waiting = {folder: None, **self._waiting}
            waiting = self.waiting
            self._changed.notify_all()
        if failure is not None and not self._behind:
            self._behind = True
            self._on_trouble(getattr(failure, "found", "") or str(failure), waiting)
        elif self._behind and not waiting:
            self._behind = False
            self._on_caught_up()
        return failure is None
