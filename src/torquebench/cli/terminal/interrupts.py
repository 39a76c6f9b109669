"""Ctrl-C during a run: pause at the next point, ask, resume or abort."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING, Literal

import typer

from torquebench.cli.failure import CHECK_FAILED, INTERRUPTED
from torquebench.cli.terminal.console import note, warn
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.campaign.measuring import RunAbortedError
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.station import Station


class BenchInterrupts:
    """Handles signals while a plan runs on a station.

    At a terminal, the first Ctrl-C pauses at the next point (with zero torque) and asks how to
    continue; a second one aborts at once. Without a terminal, Ctrl-C aborts. Termination and a
    closed terminal always abort. The bench is without torque before the process ends.

    Parameters
    ----------
    station : Station
        Station whose Ctrl-C action is set.
    progress : TerminalProgress
        Progress bars, which pause during a question.
    may_pause : bool
        False if starting again loses nothing; Ctrl-C then aborts at a terminal, too.
    finishing : threading.Event, optional
        Set by the first Ctrl-C in the place of an abort, for an operation without an end.

    Attributes
    ----------
    signal : signal.Signals or None
        The last signal received.
    abort_reason : str
        The signal that ends the operation; empty without one.
    """

    def __init__(
        self,
        station: Station,
        progress: TerminalProgress,
        *,
        may_pause: bool = True,
        finishing: threading.Event | None = None,
    ) -> None:
        self._station, self._finishing = station, finishing
        self._progress = progress
        self.signal: signal.Signals | None = None
        self.abort_reason = ""
        station.interrupt_action = "pause" if may_pause and self.interactive else "abort"

    @property
    def interactive(self) -> bool:
        """Whether a person can answer questions."""
        return sys.stdin.isatty() and sys.stderr.isatty()

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Handle the signals until the block ends."""
        wanted = {signal.SIGINT: self._on_interrupt, signal.SIGTERM: self._on_termination}
        if hasattr(signal, "SIGHUP"):
            wanted[signal.SIGHUP] = self._on_termination
        before = {number: signal.signal(number, handler) for number, handler in wanted.items()}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def ask(self, _station: Station) -> Literal["resume", "abort"]:
        """Ask whether a paused run continues; abort without an answer."""
        self._progress.pause()
        answer = ""
        try:
            while True:
                sys.stderr.write("Paused without torque. [r]esume or [a]bort? ")
                sys.stderr.flush()
                answer = sys.stdin.readline()
                if answer.strip().lower() in ("r", "resume"):
                    self.signal = None
                    return "resume"
                if not answer or answer.strip().lower() in ("a", "abort"):
                    return "abort"
        finally:
            self._progress.resume(answered=bool(answer))

    def reported(self, aborted: RunAbortedError) -> typer.Exit:
        """Report the state of an aborted run, and return the exception that ends the command."""
        warn(f"the {aborted.record.kind} run was aborted: {aborted.record.reason}")
        note(f"The bench is without torque. Kept so far: {aborted.record.folder}")
        return typer.Exit(INTERRUPTED if self.signal == signal.SIGINT else CHECK_FAILED)

    def _on_interrupt(self, _number: int, _frame: FrameType | None) -> None:
        if self._finishing is not None and not self._finishing.is_set():
            self._finishing.set()
            return
        if self._station.interrupt_action == "pause" and self.signal is None:
            self._progress.say("Pausing at the next point; Ctrl-C again aborts.")
        self.signal = signal.SIGINT
        raise KeyboardInterrupt

    def _on_termination(self, number: int, _frame: FrameType | None) -> None:
        self.signal = signal.Signals(number)
        self.abort_reason = Message("{signal} from the system", self.signal.name)
        # In another thread: the main thread may hold the run engine's locks.
        threading.Thread(
            target=self._station.abort,
            args=(self.abort_reason,),
            name="torquebench-termination",
            daemon=True,
        ).start()
