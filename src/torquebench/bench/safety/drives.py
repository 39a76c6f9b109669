"""Worker threads that poll, feed and stop the drives independently of each other.

A connected drive may be slow, and a drive that hangs must not prevent the supervisor from stopping
the other one. Every drive whose calls may block therefore gets a thread of its own.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable

from torquebench.bench.drivers.base import Drive, DriveState
from torquebench.bench.roles import Side
from torquebench.bench.safety.alarms import AlarmKind, Violation
from torquebench.bench.safety.priority import prefer_this_thread
from torquebench.message import Message

Order = Callable[[], None]
Answer = Callable[[bool], None]
SHORTEST_SILENCE_S = 0.005
ENDING_S = 2.0
"""Longest time that a worker may be busy with its drive after it was told to end, s."""


class DriveWorker:
    """Worker that polls, feeds, ramps and disables one drive.

    Parameters
    ----------
    side : {"input", "output"}
    threaded : bool
        Whether to use a separate thread, because the drive may block; otherwise the caller's
        thread.
    patience_s : float
        Longest time for which a caller waits for that thread, s of wall time; simulated time stops
        meanwhile. Simulated time must not run ahead of a drive that answers, but must continue for
        one that doesn't, so that its watchdog trips.

    Attributes
    ----------
    state : DriveState or None
        Last reported state; None before the first answer.
    asked : float
        Time of the last request, in `time.monotonic` seconds.
    failure : str
        Error of the last request; empty if the drive answered.
    """

    def __init__(
        self, side: Side, drive: Drive, *, threaded: bool, patience_s: float = 0.0
    ) -> None:
        self.side = side
        self._patience_s = patience_s
        self.drive = drive
        self.state: DriveState | None = None
        self.asked = 0.0
        self._put = 0.0
        self._states_remote = (
            False  # a drive that never reports it may accept commands from the bus nevertheless
        )
        self.failure = ""
        self._orders: queue.SimpleQueue[Order | None] = queue.SimpleQueue()
        self._idle = threading.Event()  # polling is suspended
        self._idle.set()
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(
                target=self._run, name=f"torquebench-safety-{side}", daemon=True
            )

    def start(self) -> None:
        """Start the thread, if there is one."""
        if self._thread is not None:
            self._thread.start()

    def close(self) -> None:
        """End the thread, unless it hangs in its drive."""
        if self._thread is not None and self._thread.is_alive():
            self._orders.put(None)
            self._thread.join(ENDING_S)

    def read(self, since: float) -> DriveState | None:
        """Return the state that was requested after `since` (`time.monotonic`); else None."""
        return self.state if self.asked > since and not self.failure else None

    # -- called by the supervisor ------------------------------------------------------------

    def ask(self, *, feed: bool) -> None:
        """Request the state and feed the watchdog; in a thread, one request at a time."""
        if self._thread is None:
            self._ask(feed)
        elif self.idle:
            self._put = time.monotonic()
            self._idle.clear()
            self._orders.put(lambda: self._ask(feed))

    @property
    def idle(self) -> bool:
        """Whether no request is pending."""
        return self._idle.is_set()

    def silent_s(self, since: float) -> float:
        """Return how long a request has been pending, s of wall time; 0 if none is.

        Time without a request, because this computer was busy, doesn't count.

        Parameters
        ----------
        since : float
            Earliest time from which to count, in `time.monotonic` seconds.
        """
        put = self._put
        return 0.0 if self._idle.is_set() else time.monotonic() - max(put, since)

    def found_wrong(self, since: float, enabled: float, watchdog_s: float) -> str:
        """Return the defect of a drive that has power; empty if none is known.

        Parameters
        ----------
        since : float
            Time at which it was first read with power, in `time.monotonic` seconds.
        enabled : float
            Time at which it was switched on: earlier states don't count.
        watchdog_s : float
            Longest time without an answer, s.
        """
        silent_s = self.silent_s(since)
        if self.failure or silent_s > max(watchdog_s, SHORTEST_SILENCE_S):
            return self.failure or Message("no answer for {seconds:.2f} s", silent_s)
        state = self.state
        if state is None or self.asked < max(since, enabled):
            return ""
        if state.fault or not state.enabled:
            return state.fault or "lost its enable"
        local = self._states_remote and not state.remote
        return "it went to local control and takes no commands of the bus" if local else ""

    def wait_asked(self, patience_s: float | None = None) -> None:
        """Wait for the drive's answer, at most for `patience_s`."""
        patience_s = self._patience_s if patience_s is None else patience_s
        if self._thread is not None and patience_s:
            self._idle.wait(patience_s)

    def ramp_to_zero(self, duration_s: float) -> None:
        """Command the drive to zero torque and speed; disable it if that fails."""
        self._order(lambda: self._ramp(duration_s))

    def disable(self, done: Answer) -> None:
        """Switch off the power, then call `done` with whether the command succeeded."""

        def disable() -> None:
            """Switch the drive off, and report whether it took the command."""
            try:
                self.drive.disable()
            except Exception:  # its own watchdog has to trip
                done(False)
            else:
                done(True)

        self._order(disable)

    def _order(self, order: Order) -> None:
        """Have the worker's thread execute an order, and wait for it as long as patience allows.

        Without that thread, or within it, the order is executed at once.
        """
        thread = self._thread
        if thread is None or not thread.is_alive() or thread is threading.current_thread():
            order()
            return
        executed = threading.Event()

        def execute() -> None:
            try:
                order()
            finally:
                executed.set()

        self._orders.put(execute)
        if self._patience_s:
            executed.wait(self._patience_s)

    # -- on the thread ----------------------------------------------------------------------

    def _run(self) -> None:
        """Execute orders until the worker is closed."""
        prefer_this_thread()
        while (order := self._orders.get()) is not None:
            order()

    def _ramp(self, duration_s: float) -> None:
        """Ramp to zero; switch the drive off if that fails."""
        try:
            self.drive.ramp_to_zero(duration_s)
        except Exception:  # whatever the error, the drive must not continue
            with contextlib.suppress(Exception):
                self.drive.disable()

    def _ask(self, feed: bool) -> None:
        """Read the drive's state and feed its watchdog; a failure is kept as text."""
        try:
            if feed:
                self.drive.feed_watchdog()
            requested = time.monotonic()
            self.state = self.drive.state()
            self._states_remote |= self.state.remote
            self.asked = requested
        except Exception as error:  # a broken connection is treated like a broken drive
            self.failure = Message("{name}: {error}", type(error).__name__, error)
        else:
            self.failure = ""
        finally:
            self._idle.set()


def unreachable(side: Side) -> Violation:
    """Return the violation by a drive that doesn't accept the command to switch off."""
    return Violation(
        AlarmKind.DRIVE_FAULT,
        side,
        Message("{side} drive: it can't be switched off", side),
        "a drive that accepts commands",
        "check its connection; its own watchdog switches the power off",
    )
