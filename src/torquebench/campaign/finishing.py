"""Finish an interrupted run: fit and register what is already measured.

Command line, panel and API all use this, interrupted or not: `finish_calibration` fits and
registers a calibration right after its run, or days later from its folder. Nothing is measured
again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial

from torquebench.calibration import Profile, verify
from torquebench.campaign.bench_chains import recorded_effects, used_chain
from torquebench.campaign.checking import finish_check
from torquebench.campaign.fitting import (
    FittedModel,
    ModelChoice,
    fit_metrics,
    fit_models,
    model_in_use,
    store_model,
)
from torquebench.campaign.measuring import Measured
from torquebench.campaign.registering import (
    FittedFile,
    RegisteredCalibration,
    read_measured,
    register_calibration,
    register_verification,
    registered_choices,
    registered_patiently,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures import StaircaseResult
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import (
    REGISTERS,
    Registry,
    RunFolder,
    RunState,
    UnfinishedRun,
    unfinished_runs,
)
from torquebench.station.entering import enter_run, require_original

__all__ = [
    "Finished",
    "FinishedCalibration",
    "calibration_fit",
    "discard_run",
    "find_unfinished",
    "finish_calibration",
    "finish_run",
    "measured_calibration",
]


@dataclass(frozen=True)
class FinishedCalibration:
    """A calibration with the models that were fitted to it, all registered.

    Parameters
    ----------
    measured : Measured
    profile : Profile
    fitted : tuple of FittedModel
    registered : RegisteredCalibration
    active : str or None
        Name of the model that was put into use; None where its calibration contradicts itself.
    """

    measured: Measured[StaircaseResult]
    profile: Profile
    fitted: tuple[FittedModel, ...]
    registered: RegisteredCalibration
    active: str | None


@dataclass(frozen=True)
class Finished:
    """Result of finishing a run.

    Parameters
    ----------
    run_id : str
    sentence : str
        In words.
    calibration : FinishedCalibration or None
        Where it was a calibration.
    """

    run_id: str
    sentence: str
    calibration: FinishedCalibration | None = None


def calibration_fit(
    registry: Registry,
    measured: Measured[StaircaseResult],
    profile: Profile,
    choices: Sequence[ModelChoice],
    progress: Progress = NO_PROGRESS,
) -> partial[list[FittedModel]]:
    """Return the fit of models to a calibration, to be called here or in another process.

    It takes `progress` and `title` as `fit_models` does. The parameters are those of
    `finish_calibration`.
    """
    data, run_id = measured.result.data, measured.record.run_id
    return partial(
        fit_models,
        data,
        choices,
        effects=recorded_effects(measured.record.metadata, data),
        limits=profile.plausibility,
        before=registered_patiently(
            registry, run_id, lambda: model_in_use(registry, data), progress
        ),
    )


def finish_calibration(
    registry: Registry,
    measured: Measured[StaircaseResult],
    profile: Profile,
    choices: Sequence[ModelChoice],
    active: str | None,
    progress: Progress = NO_PROGRESS,
    *,
    title: str = "",
    fitted: Sequence[FittedModel] | None = None,
) -> FinishedCalibration:
    """Fit models to a calibration, register it with them, and put one into use.

    Parameters
    ----------
    registry : Registry
    measured : Measured
        The calibration; its folder is sealed.
    profile : Profile
        That it followed.
    choices : sequence of ModelChoice
    active : str or None
        Name of the one that the module compensates with from now on, unless its calibration
        contradicts itself; None if undecided.
    progress : Progress
    title : str
        Of the stage of fitting.
    fitted : sequence of FittedModel, optional
        What `calibration_fit` has returned, if it was called before.

    Raises
    ------
    RecordError
        The registry or the disk can't take it. Everything is measured: it can be finished later.
    """
    data, run_id = measured.result.data, measured.record.run_id
    if fitted is None:
        fit = calibration_fit(registry, measured, profile, choices, progress)
        title = title or Message("Fitting the {side} module", data.side)
        fitted = fit(progress=progress, title=title)
    if any(item.contradictions for item in fitted if item.name == active):
        active = None

    models = {item.name: item for item in fitted}
    files = [
        FittedFile(
            item.name,
            item.model.kind,
            registry.root / "models" / f"{run_id}-{item.name}.json",
            fit_metrics(item, data),
            item.contradictions,
        )
        for item in fitted
    ]

    def store(file: FittedFile) -> None:
        item = models[file.name]
        store_model(
            file.path,
            item.model,
            data,
            file.metrics,
            item.effects,
            item.contradictions,
            private=True,
        )

    def register() -> RegisteredCalibration:
        folder = RunFolder(measured.record.folder)
        return register_calibration(registry, folder, files, active, store=store)

    registered = registered_patiently(registry, run_id, register, progress)
    return FinishedCalibration(measured, profile, tuple(fitted), registered, active)


def find_unfinished(registry: Registry, name: str) -> UnfinishedRun:
    """Return an unfinished run by its id or the beginning of it, or "latest".

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    every = unfinished_runs(registry)
    own = [run for run in every if run.state is not RunState.COPY]
    found = own[-1:] if name == "latest" else [r for r in every if r.run_id.startswith(name)]
    if len(found) > 1:  # a copy's name often begins with that of its run
        found = [r for r in found if r.run_id == name] or found
    if len(found) != 1:
        raise InputError(
            Message(
                "{name!r} names {found}",
                name,
                "several unfinished runs" if found else "no unfinished run",
            ),
            "a run that isn't finished",
            "see `torquebench records list runs`",
        )
    return found[0]


def finish_run(
    registry: Registry, run: UnfinishedRun, progress: Progress = NO_PROGRESS
) -> Finished:
    """Complete a run as far as possible without the bench.

    Parameters
    ----------
    registry : Registry
    run : UnfinishedRun
        From `unfinished_runs`.
    progress : Progress

    Raises
    ------
    InputError
        It is an interrupted calibration, which must be resumed on its bench.
    RecordError
        Its folder was changed, or the registry can't take it.
    """
    folder = RunFolder.open(run.folder)
    if run.state is RunState.LEFT_OPEN:
        folder.recover()
    if run.state in (RunState.LEFT_OPEN, RunState.SEALED):
        enter_run(registry, folder)
        rest = [each for each in unfinished_runs(registry) if each.run_id == run.run_id]
        if not rest or rest[0].state is RunState.INTERRUPTED:
            status = folder.manifest["status"]
            return Finished(
                run.run_id, Message("run {run_id} is entered as {status}", run.run_id, status)
            )
    if run.state is RunState.COPY:
        raise InputError(run.found, "a run's own folder", run.remedy)
    if run.state is RunState.INTERRUPTED:
        raise InputError(
            Message("run {run} was interrupted", run.run_id),
            "a run that is measured",
            Message("resume it with `torquebench resume {run}`", run.run_id),
        )
    folder.verify()
    kind = str(folder.metadata["kind"]).partition("-")[0]
    return _FINISHERS[kind](registry, folder, progress)


def discard_run(registry: Registry, run: UnfinishedRun, *, by: str, reason: str) -> None:
    """Discard an unfinished run; its measured data stay in its folder.

    Raises
    ------
    InputError
        Nobody or no reason is named.
    RecordError
        The registry can't take it.
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
        registry.discard_run(run.run_id, by=by, reason=reason)


def measured_calibration(
    registry: Registry, folder: RunFolder, progress: Progress = NO_PROGRESS
) -> FinishedCalibration:
    """Fit and register a calibration from its folder, with the models that it was begun with.

    A model is put into use as the run's command would have done, unless its module was
    calibrated again since.
    """
    measured, profile = read_measured(folder)
    choices, active = registered_choices(folder.metadata)
    serial = measured.result.data.transducer_serial
    newest = registry.calibrations(serial, limit=1)
    if newest and newest[0].performed > datetime.fromisoformat(folder.manifest["sealed"]):
        active = None
    return finish_calibration(registry, measured, profile, choices, active, progress)


def _calibration(registry: Registry, folder: RunFolder, progress: Progress) -> Finished:
    found = measured_calibration(registry, folder, progress)
    entry = found.registered.calibration
    numbers = ", ".join(f"model-{each.model_id}" for each in found.registered.models.values())
    said = Message(
        "run {run_id} is registered as calibration-{calibration_id} with {numbers}",
        folder.run_id,
        entry.calibration_id,
        numbers,
    )
    return Finished(folder.run_id, said, found)


def _check(registry: Registry, folder: RunFolder, progress: Progress) -> Finished:
    found = finish_check(registry, read_measured(folder)[0], progress)
    return Finished(
        folder.run_id,
        Message("run {run_id} is registered: {label}", folder.run_id, found.verdict.label),
    )


def _verification(registry: Registry, folder: RunFolder, progress: Progress) -> Finished:
    measured, _ = read_measured(folder)
    numbers: Mapping[str, int] = folder.metadata[REGISTERS]["models"]

    def register() -> None:
        models = {name: registry.model(int(number)) for name, number in numbers.items()}
        data = measured.result.data
        loaded = {name: used_chain(entry, folder.metadata, data) for name, entry in models.items()}
        result = verify(data, loaded)
        register_verification(registry, models, result, measured.record)

    registered_patiently(registry, folder.run_id, register, progress)
    return Finished(
        folder.run_id, Message("run {run_id} is registered as a verification", folder.run_id)
    )


_FINISHERS = {"calibrate": _calibration, "check": _check, "verify": _verification}
