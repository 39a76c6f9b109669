"""`torquebench records finish` and `discard`: complete or discard unfinished runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.terminal.console import answer, say
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.records import Registry, UnfinishedRun

__all__ = ["discard", "finish", "finish_and_report"]


def finish(
    run: Annotated[
        str | None,
        typer.Argument(help="A run's id or its beginning, or `latest`; without it all of them."),
    ] = None,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Register and fit runs that were interrupted before their registration.

    Nothing is measured again. Resume an interrupted calibration on its bench with `torquebench
    calibrate --resume`.
    """
    from torquebench.campaign.finishing import find_unfinished
    from torquebench.records import Registry, RunState, unfinished_runs
    from torquebench.station.bench_lock import BenchLock

    folder = data_directory(data)
    with BenchLock(None, folder), Registry.open(folder) as registry:
        if run is not None:
            finish_and_report(registry, find_unfinished(registry, run))
            return
        answer(finished=[])
        every = unfinished_runs(registry)
        for each in every:
            if each.state in (RunState.INTERRUPTED, RunState.COPY):
                say(f"{each.found}: {each.remedy}")
                answer(unfinished=[each.run_id])
            else:
                finish_and_report(registry, each)
        if not every:
            say("Every run is finished.")


def finish_and_report(registry: Registry, run: UnfinishedRun, reports: Sequence[Path] = ()) -> None:
    """Finish a run, print the result of it and write its report."""
    from torquebench.campaign.finishing import finish_run
    from torquebench.cli.calibrating import report_calibration, write_calibration_reports
    from torquebench.cli.terminal.progress import TerminalProgress

    with TerminalProgress() as progress:
        finished = finish_run(registry, run, progress)
    if finished.calibration is not None:
        report_calibration(finished.calibration)
        write_calibration_reports(finished.calibration, reports)
    say(f"{finished.sentence}. Nothing was measured.")
    answer(finished=[finished.run_id])


def discard(
    run: Annotated[str, typer.Argument(help="A run's id or its beginning, or `latest`.")],
    reason: Annotated[str, typer.Option(help="Why the run is discarded.")],
    by: Annotated[
        str, typer.Option(help="Person who decides; by default the logged-in user.")
    ] = "",
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Close an unfinished run without a result. Its data stay in its folder."""
    from torquebench.campaign.finishing import discard_run, find_unfinished
    from torquebench.campaign.measuring import operator_name
    from torquebench.records import Registry
    from torquebench.station.bench_lock import BenchLock

    if not reason.strip():
        raise InputError("a run discarded without a reason", "a reason")
    folder = data_directory(data)
    with BenchLock(None, folder), Registry.open(folder) as registry:
        found = find_unfinished(registry, run)
        discard_run(registry, found, by=by or operator_name(), reason=reason)
    answer(record=f"run {found.run_id}")
    say(f"run {found.run_id} is discarded on the record; its folder stays as it is.")
