"""Messages about runs that a command found unfinished, and about warnings while it works."""

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

__all__ = ["tell_recovered", "tell_unfinished", "tell_warnings"]


def tell_recovered(station: Station, *, but: str = "") -> None:
    """List the recovered and newly registered runs, the data kept, and the remedy.

    Parameters
    ----------
    station : Station
        Just opened.
    but : str
        A run that needs no word, since the command is about it.
    """
    from torquebench.records import unfinished_runs

    unfinished = {run.run_id: run for run in unfinished_runs(station.registry)}
    for run in station.recovered:
        named = unfinished.pop(run.run_id, None)
        if but and run.run_id.startswith(but):
            continue
        if run.status != "interrupted":  # sealed, and not in the registry yet
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
    """List the unfinished runs and the remedy."""
    for run in runs:
        warn(f"{run.found}: {run.remedy}")


def tell_doubts(station: Station, standard: str) -> None:
    """Warn of a clock that is behind, and of the expired standard that is measured against."""
    from torquebench.campaign.doubts import doubts_before

    for doubt in doubts_before(station, station.registry, standard):
        warn(doubt)


@contextlib.contextmanager
def tell_warnings(station: Station, progress: TerminalProgress) -> Iterator[None]:
    """Say every warning of the bench that comes up until the block ends, and when it is over."""
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
