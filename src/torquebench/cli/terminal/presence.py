"""Confirm the operator's presence at the terminal at regular intervals.

With `safety.presence_s`, drives have power only while the operator regularly confirms to be at the
bench, by any key or an answer to a question. A line reminds the operator in time. Without a
terminal nobody can confirm, and a bench that requires it doesn't move. Only the bench description
sets this requirement; no command can change it.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from torquebench.errors import InputError, InterlockError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.station import Station

POLL_S = 0.1
REMINDER = 1.0 / 3.0
"""Remaining share of the interval at which the reminder appears."""


@contextlib.contextmanager
def attending(station: Station, progress: TerminalProgress) -> Iterator[None]:
    """Read keys for the operator's presence until the block ends, if the bench requires it.

    Parameters
    ----------
    station : Station
    progress : TerminalProgress
        Progress bars, which signal when a question needs the keys.

    Raises
    ------
    InputError
        The bench requires presence, and there is no terminal.
    """
    period_s = station.description.safety.presence_s
    if period_s <= 0.0:
        yield
        return
    if not sys.stdin.isatty():
        raise InputError(
            Message(
                "{name} requires the operator's presence every {period_s:g} s and there "
                "is no terminal",
                station.description.name,
                period_s,
            ),
            "a person at a terminal, or at the panel",
            "run it at a terminal or from the panel; if other safeguards keep people away from "
            "the bench, set safety.presence_s = 0 in its description",
        )
    with _Attendance(station, progress, period_s).taking_keys():
        yield


class _Attendance:
    """Confirms presence at each key, in a separate thread; inactive during a question."""

    def __init__(self, station: Station, progress: TerminalProgress, period_s: float) -> None:
        from torquebench.records.signatures import operator_name

        self._supervisor = station.supervisor
        self._progress = progress
        self._period_s = period_s
        self._who = operator_name()
        self._keys = _Keys()
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._asking = False
        self._confirmed_s = time.monotonic()
        self._reminded = False
        self._thread = threading.Thread(target=self._run, name="torquebench-presence", daemon=True)

    @contextlib.contextmanager
    def taking_keys(self) -> Iterator[None]:
        """Wait for the first key, then read keys until the block ends."""
        try:
            self._keys.take()
            self._progress.say(
                f"This bench requires your presence: press a key every {self._period_s:g} s."
            )
            self._progress.say("Press a key to begin.")
            while not self._keys.pressed(POLL_S):
                if self._keys.gone:
                    raise InterlockError("the terminal was closed", "somebody at a terminal")
            self._confirm()
            self._progress.attendance = self
            self._thread.start()
            yield
        finally:
            self._progress.attendance = None
            self._ending.set()
            if self._thread.is_alive():
                self._thread.join()
            self._keys.give_back()

    def pause(self) -> None:
        """Stop reading keys during a question."""
        with self._lock:
            self._asking = True
            self._keys.give_back()

    def resume(self, *, answered: bool) -> None:
        """Read keys again; an answer at this terminal counts as a confirmation."""
        with self._lock:
            if answered:
                self._confirm()
            self._keys.take()
            self._asking = False

    def _confirm(self) -> None:
        self._confirmed_s = time.monotonic()
        self._reminded = False
        self._supervisor.heartbeats.confirm_presence(self._who)

    def _run(self) -> None:
        while not (self._ending.wait(0.0) or self._keys.gone):
            with self._lock:
                if not self._asking and self._keys.pressed(POLL_S):
                    self._confirm()
            self._remind()
            time.sleep(0.01)  # let a waiting thread get the lock

    def _remind(self) -> None:
        left_s = self._period_s - (time.monotonic() - self._confirmed_s)
        if self._asking or self._reminded or left_s > REMINDER * self._period_s:
            return
        self._reminded = True
        self._progress.say(f"Are you there? Press a key within {max(0.0, left_s):.0f} s.\a")


if sys.platform == "win32":  # pragma: no cover - the tests run elsewhere
    import msvcrt

    class _Keys:
        """Single keys of the Windows console."""

        gone = False

        def take(self) -> None:
            """Do nothing: the Windows console needs no preparation."""

        def give_back(self) -> None:
            """Do nothing: the Windows console wasn't changed."""

        def pressed(self, timeout_s: float) -> bool:
            """Return whether a key was pressed, waiting for one."""
            deadline = time.monotonic() + timeout_s
            while not msvcrt.kbhit():
                if time.monotonic() >= deadline:
                    return False
                time.sleep(0.01)
            while msvcrt.kbhit():
                msvcrt.getch()
            return True

else:
    import termios

    class _Keys:
        """Single keys of the terminal, without echo; Ctrl-C still interrupts."""

        def __init__(self) -> None:
            self._file = sys.stdin.fileno()
            self.gone = False
            self._before: Any = None

        def take(self) -> None:
            """Read keys without waiting for the end of a line."""
            if self._before is not None:
                return
            try:
                self._before = termios.tcgetattr(self._file)
                changed = termios.tcgetattr(self._file)
                changed[3] &= ~(termios.ICANON | termios.ECHO)
                termios.tcsetattr(self._file, termios.TCSANOW, changed)
            except termios.error:  # the terminal has been closed
                self.gone = True

        def give_back(self) -> None:
            """Restore the terminal."""
            before, self._before = self._before, None
            if before is not None:
                with contextlib.suppress(termios.error):  # the terminal has been closed
                    termios.tcsetattr(self._file, termios.TCSANOW, before)

        def pressed(self, timeout_s: float) -> bool:
            """Return whether a key was pressed, waiting for one."""
            if not select.select([self._file], [], [], timeout_s)[0]:
                return False
            with contextlib.suppress(OSError):
                if os.read(self._file, 1024):
                    return True
            self.gone = True
            return False
