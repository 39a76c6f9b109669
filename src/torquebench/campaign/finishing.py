"""Finish a recorded run: look up its kind, and evaluate and register it without measuring again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torquebench.campaign.calibrating import CALIBRATION, FinishedCalibration
from torquebench.campaign.checking import CHECK
from torquebench.campaign.measuring import RunKind
from torquebench.campaign.registering import read_measured
from torquebench.campaign.verifying import VERIFICATION
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry, RunFolder, RunState, UnfinishedRun, unfinished_runs
from torquebench.records.signatures import Signature
from torquebench.station.entering import enter_run, require_original

REGISTERED: dict[str, RunKind[Any, Any, Any]] = {
    kind.kind.partition("-")[0]: kind for kind in (CALIBRATION, CHECK, VERIFICATION)
}
"""Kinds of runs whose results have registry entries of their own, by the first part of the kind."""


@dataclass(frozen=True)
class Finished:
    """Result of finishing a run.

    Parameters
    ----------
    sentence : str
        Result in one sentence.
    calibration : FinishedCalibration or None
        Result of a calibration, else None.
    """

    run_id: str
    sentence: str
    calibration: FinishedCalibration | None = None


def find_unfinished(registry: Registry, name: str) -> UnfinishedRun:
    """Return an unfinished run by its id, by the beginning of its id, or by "latest".

    Raises
    ------
    InputError
        No unfinished run, or more than one, has this name.
    """
    every = unfinished_runs(registry)
    own = [run for run in every if run.state is not RunState.COPY]
    runs = own[-1:] if name == "latest" else [r for r in every if r.run_id.startswith(name)]
    if len(runs) > 1:  # the name of a copied folder often begins with the id of its run
        runs = [r for r in runs if r.run_id == name] or runs
    if len(runs) != 1:
        raise InputError(
            Message(
                "{name!r} names {found}",
                name,
                "several unfinished runs" if runs else "no unfinished run",
            ),
            "a run that isn't finished",
            "see `torquebench records list runs`",
        )
    return runs[0]


def finish_recorded_run(
    registry: Registry, run: UnfinishedRun, progress: Progress = NO_PROGRESS
) -> Finished:
    """Complete an unfinished run from its folder, by the evaluation and entry of its kind.

    Parameters
    ----------
    run : UnfinishedRun
        From `unfinished_runs`.

    Raises
    ------
    InputError
        The run is an interrupted calibration, which must be resumed on its bench.
    RecordError
        The run's folder was changed, or the registry can't record the run.
    """
    folder = RunFolder.open(run.folder)
    if run.state is RunState.LEFT_OPEN:
        folder.recover()
    if run.state in (RunState.LEFT_OPEN, RunState.SEALED):
        enter_run(registry, folder)
        rest = [
            unfinished_run
            for unfinished_run in unfinished_runs(registry)
            if unfinished_run.run_id == run.run_id
        ]
        if not rest or rest[0].state is RunState.INTERRUPTED:
            status = folder.manifest["status"]
            return Finished(
                run.run_id, Message("run {run_id} is entered as {status}", run.run_id, status)
            )
    if run.state is RunState.COPY:
        raise InputError(run.found, "the original folder of a run", run.remedy)
    if run.state is RunState.INTERRUPTED:
        raise InputError(
            Message("run {run} was interrupted", run.run_id),
            "a run that is measured",
            Message("resume it with `torquebench resume {run}`", run.run_id),
        )
    folder.verify()
    kind = REGISTERED[str(folder.metadata["kind"]).partition("-")[0]]
    outcome = kind.evaluate_and_register(registry, read_measured(folder), progress)
    calibration = outcome if isinstance(outcome, FinishedCalibration) else None
    return Finished(run.run_id, kind.describe(outcome), calibration)


def discard_run(
    registry: Registry,
    run: UnfinishedRun,
    *,
    by: str,
    reason: str,
    signature: Signature | None = None,
) -> None:
    """Discard an unfinished run; its measured data stay in its folder.

    Raises
    ------
    InputError
        The name or the reason is missing.
    RecordError
        The registry can't record the run.
    """
    if not by.strip() or not reason.strip():
        raise InputError(
            Message("run {run} discarded without a reason", run.run_id), "a name and a reason"
        )
    folder = RunFolder.open(run.folder)
    require_original(folder)
    if run.state is RunState.LEFT_OPEN:
        folder.recover()
    with registry.writing():
        enter_run(registry, folder)
        registry.discard_run(run.run_id, by=by, reason=reason, signature=signature)
