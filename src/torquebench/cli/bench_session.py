"""Open a bench for a command that measures with a person at the terminal."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.bench.prompts import PromptQueue, QueuedOperator
from torquebench.campaign.measuring import RunAbortedError
from torquebench.cli.recovered import tell_recovered, tell_warnings
from torquebench.cli.terminal.compilation import telling_compilation
from torquebench.cli.terminal.console import note, say, stderr_console
from torquebench.cli.terminal.interrupts import BenchInterrupts
from torquebench.cli.terminal.presence import attending
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.cli.terminal.prompts import answering
from torquebench.station import Station

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription


@dataclass(frozen=True)
class BenchSession:
    """An open bench, and the answering of its questions.

    Parameters
    ----------
    station : Station
    prompts : PromptQueue
        Questions of the bench.
    yes : bool
        Whether to confirm all questions without asking.
    """

    station: Station
    prompts: PromptQueue
    yes: bool

    @contextlib.contextmanager
    def measuring(
        self, *, may_pause: bool = True, finishing: threading.Event | None = None
    ) -> Iterator[tuple[TerminalProgress, BenchInterrupts]]:
        """Show progress and warnings, and handle keys and Ctrl-C, until the block ends.

        Parameters
        ----------
        may_pause : bool
            False if starting again loses nothing; Ctrl-C then aborts.
        finishing : threading.Event, optional
            Set by the first Ctrl-C in the place of an abort.

        Yields
        ------
        progress : TerminalProgress
        interrupts : BenchInterrupts
            Asks whether a paused run continues.

        Raises
        ------
        typer.Exit
            The run was aborted; a message states the folder of its data.
        """
        progress = TerminalProgress()
        interrupts = BenchInterrupts(
            self.station, progress, may_pause=may_pause, finishing=finishing
        )
        try:
            with (
                progress,
                tell_warnings(self.station, progress),
                attending(self.station, progress),
                interrupts.watching(),
                answering(self.prompts, progress, yes=self.yes),
            ):
                yield progress, interrupts
        except RunAbortedError as aborted:
            raise interrupts.reported(aborted) from None


@contextlib.contextmanager
def open_bench(
    description: BenchDescription,
    data: Path,
    *,
    real_time: bool,
    yes: bool,
    resumed: str = "",
    announce: bool = True,
) -> Iterator[BenchSession]:
    """Open a bench for measuring, and list its unfinished runs.

    Parameters
    ----------
    description : BenchDescription
    data : pathlib.Path
        Folder of the registry and of all runs.
    real_time : bool
        Whether simulated time follows the wall clock.
    yes : bool
        Whether to confirm all questions of the bench without asking.
    resumed : str
        An unfinished run that isn't listed, because the command resumes it.
    announce : bool
        Whether to state that the bench is simulated; False if the caller does so.
    """
    if description.simulated and announce:
        note("simulated bench")
    prompts = PromptQueue()
    operator = None if description.simulated else QueuedOperator(prompts)
    with (
        telling_compilation(stderr_console()),
        Station.open(description, data, real_time=real_time, operator=operator) as station,
    ):
        tell_recovered(station, but=resumed)
        yield BenchSession(station, prompts, yes)


@contextlib.contextmanager
def rehearsing(description: BenchDescription) -> Iterator[Station]:
    """Open the bench with a temporary folder to rehearse a plan; state that nothing was moved."""
    with (
        tempfile.TemporaryDirectory() as scratch,
        Station.open(description, Path(scratch)) as station,
    ):
        yield station
    say("Limits and interlocks checked; nothing was moved.")
