"""Messages about unfinished runs at the start of a command, and about warnings during it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from torquebench.cli.terminal.console import warn

if TYPE_CHECKING:
    from torquebench.bench.safety import RaisedAlarm
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.records import UnfinishedRun
    from torquebench.station import Station


def tell_recovered(station: Station, *, but: str = "") -> None:
    """List recovered and newly registered runs, their data, and the remedy.

    Parameters
    ----------
    station : Station
        Station that was just opened.
    but : str
        A run that isn't listed, because the command resumes it.
    """
    from torquebench.records import unfinished_runs

    unfinished = {run.run_id: run for run in unfinished_runs(station.registry)}
    for run in station.recovered:
        named = unfinished.pop(run.run_id, None)
        if but and run.run_id.startswith(but):
            continue
        if run.status != "interrupted":  # sealed, but not registered before
            warn(f"run {run.run_id} ({run.status}) is entered now, from its folder")
            tell_unfinished([named] if named else [])
            continue
        kept = "1 acknowledged point is" if run.points == 1 else f"{run.points} points are"
        torn = f", {run.torn_bytes} incomplete bytes left out" if run.torn_bytes else ""
        damaged = f", damaged and left out: {run.damaged}" if run.damaged else ""
        advice = named.remedy if named else run.advice
        warn(f"run {run.run_id} was interrupted; {kept} kept{torn}{damaged}: {advice}")
    tell_unfinished(
        [run for run in unfinished.values() if not (but and run.run_id.startswith(but))]
    )


def tell_unfinished(runs: list[UnfinishedRun]) -> None:
    """List unfinished runs and their remedies."""
    for run in runs:
        warn(f"{run.found}: {run.remedy}")


def tell_doubts(station: Station, standard: str) -> None:
    """Warn of a clock that is slow, and of a standard whose certificate has expired."""
    from torquebench.campaign.doubts import doubts_before

    for doubt in doubts_before(station, station.registry, standard):
        warn(doubt)


@contextlib.contextmanager
def tell_warnings(station: Station, progress: TerminalProgress) -> Iterator[None]:
    """Print every warning of the bench during the block, and when it is cleared."""
    from torquebench.bench.safety import AlarmLevel

    speaking = True

    def tell(entry: RaisedAlarm) -> None:
        alarm = entry.alarm
        if not speaking or alarm.level is not AlarmLevel.WARNING or entry.acknowledged:
            return
        if entry.cleared is not None:
            progress.say(f"over: {alarm.name}")
        else:
            progress.say(f"warning  {alarm.name}: {alarm.found}; {alarm.remedy}")

    station.supervisor.subscribe(tell)
    try:
        yield
    finally:
        speaking = False
