"""`torquebench calibrate --resume RUN`: continue an interrupted calibration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.options import data_directory
from torquebench.cli.terminal.console import note, warn
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.drivers.base import Side
    from torquebench.campaign.fitting import ModelChoice
    from torquebench.campaign.resuming import InterruptedCalibration
    from torquebench.cli.options import BenchOptions

__all__ = ["resume_run"]


def resume_run(
    name: str,
    sides: tuple[Side, ...],
    model: ModelChoice | None,
    options: BenchOptions,
    reports: Sequence[Path] = (),
) -> None:
    """Recover unfinished runs, read the run back and continue with it.

    A run that is measured already is fitted and registered; its bench isn't opened.

    Parameters
    ----------
    name : str
        Of the run: its id, the beginning of it, or "latest".
    sides : tuple of str
        Modules that were named; empty where none was.
    model : ModelChoice or None
        None takes the one that it was begun with.
    options : BenchOptions
        Without a bench description that of the run.
    reports : sequence of pathlib.Path
        Where its report is written.
    """
    from torquebench.cli.calibrating import run_calibrations
    from torquebench.cli.terminal.confirming import confirm_start
    from torquebench.procedures.staircase import describe_step

    interrupted = _read(name, options.data, reports)
    if interrupted is None:
        return
    if sides and sides != (interrupted.side,):
        raise InputError(
            Message("{sides} with --resume {name}", " and ".join(sides), name),
            Message(
                "the {side} module, which run {run_ids} calibrates",
                interrupted.side,
                interrupted.run_ids[-1],
            ),
            "leave the module out",
        )
    description = _recorded(interrupted) if options.bench is None else options.description()
    note(
        f"resuming {interrupted.run_ids[-1]} at series {interrupted.series}: "
        f"{len(interrupted.kept)} points are kept, {interrupted.repeated} are measured again"
    )
    if interrupted.damaged:
        named = "; ".join(describe_step(step) for step in interrupted.damaged)
        warn(f"the record of these points is damaged, they are measured again: {named}")
    confirm_start(description, interrupted.side, interrupted.profile, options.yes)
    run_calibrations(
        description,
        (interrupted.side,),
        interrupted.profile,
        model,
        options,
        interrupted=interrupted,
        reports=reports,
    )


def _read(name: str, data: Path, reports: Sequence[Path]) -> InterruptedCalibration | None:
    """Read a run back; None where only its registration was missing, which is then done."""
    from torquebench.campaign.finishing import find_unfinished
    from torquebench.campaign.resuming import find_interrupted, read_interrupted
    from torquebench.cli.finish import finish_and_report
    from torquebench.records import Registry
    from torquebench.station import recover_unfinished
    from torquebench.station.bench_lock import BenchLock

    folder = data_directory(data)
    with BenchLock(None, folder), Registry.open(folder) as registry:
        recover_unfinished(registry)
        run = find_interrupted(registry, name)
        if run.status != "completed" or registry.calibration_of_run(run.run_id) is not None:
            return read_interrupted(registry, run)
        finish_and_report(registry, find_unfinished(registry, run.run_id), reports)
    return None


def _recorded(interrupted: InterruptedCalibration) -> BenchDescription:
    from torquebench.bench.description import BenchDescription
    from torquebench.validation import validated

    source = f"the bench in the record of {interrupted.run_ids[-1]}"
    return validated(BenchDescription, interrupted.bench, source)
