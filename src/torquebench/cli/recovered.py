"""What a command says of runs that it found interrupted when it opened the bench."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.console import warn

if TYPE_CHECKING:
    from torquebench.station import Station

__all__ = ["tell_recovered"]


def tell_recovered(station: Station, *, but: str = "") -> None:
    """Say which runs were found open, what was kept of them and what to do.

    Parameters
    ----------
    station : Station
        Just opened.
    but : str
        A run that needs no word, since the command is about it.
    """
    for run in station.recovered:
        if run.run_id == but:
            continue
        kept = "1 acknowledged point is" if run.points == 1 else f"{run.points} points are"
        torn = f", {run.torn_bytes} incomplete bytes left out" if run.torn_bytes else ""
        damaged = f", damaged and left out: {run.damaged}" if run.damaged else ""
        warn(f"run {run.run_id} was interrupted; {kept} kept{torn}{damaged}: {run.advice}")
