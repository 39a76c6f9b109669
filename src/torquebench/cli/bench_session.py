"""A bench that a command opens, and measures on with a person at the terminal."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.bench.prompts import PromptQueue, QueuedOperator
from torquebench.campaign.measuring import OnPause, RunAbortedError
from torquebench.cli.models.compiling import telling_compilation
from torquebench.cli.recovered import tell_recovered, tell_warnings
from torquebench.cli.terminal.console import note, say, stderr_console
from torquebench.cli.terminal.interrupts import BenchInterrupts
from torquebench.cli.terminal.presence import attending
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.cli.terminal.prompts import answering
from torquebench.station import Station

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription

__all__ = ["BenchSession", "open_bench", "rehearsing"]


@dataclass(frozen=True)
class BenchSession:
    """An open bench and how its questions are answered.

    Parameters
    ----------
    station : Station
    prompts : PromptQueue
        Questions of the bench.
    yes : bool
        Confirm all of them without asking.
    """

    station: Station
    prompts: PromptQueue
    yes: bool

    @contextlib.contextmanager
    def measuring(self, *, may_pause: bool = True) -> Iterator[tuple[TerminalProgress, OnPause]]:
        """Show progress and warnings, and take keys and Ctrl-C, until the block ends.

        Parameters
        ----------
        may_pause : bool
            False where nothing is lost by starting again: then Ctrl-C aborts.

        Yields
        ------
        progress : TerminalProgress
        on_pause : callable
            Asks whether a paused run continues.

        Raises
        ------
        typer.Exit
            The run was aborted; a message states what is kept.
        """
        progress = TerminalProgress()
        interrupts = BenchInterrupts(self.station, progress, may_pause=may_pause)
        try:
            with (
                progress,
                tell_warnings(self.station, progress),
                attending(self.station, progress),
                interrupts.watching(),
                answering(self.prompts, progress, yes=self.yes),
            ):
                yield progress, interrupts.ask
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
    """Open a bench for measuring, and say which runs were found unfinished.

    Parameters
    ----------
    description : BenchDescription
    data : pathlib.Path
        Folder of the registry and of all runs.
    real_time : bool
        Whether simulated time follows the wall clock.
    yes : bool
        Confirm all questions of the bench without asking.
    resumed : str
        An unfinished run that needs no message, because the command is about it.
    announce : bool
        Whether a simulated bench is named; else the caller has done so.
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
    """Open the bench on a scratch folder to rehearse a plan; say that nothing was moved."""
    with (
        tempfile.TemporaryDirectory() as scratch,
        Station.open(description, Path(scratch)) as station,
    ):
        yield station
    say("Limits and interlocks checked; nothing was moved.")
