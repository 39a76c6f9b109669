"""Calibrate a module: measure, fit, register, and put a model into use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Unpack

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.roles import Side
from torquebench.calibration import Profile
from torquebench.campaign.bench_chains import recorded_effects
from torquebench.campaign.fitting import (
    FittedModel,
    ModelChoice,
    described_model,
    entry_in_use,
    fit_metrics,
    fit_models,
    model_in_use,
    not_compared,
)
from torquebench.campaign.measuring import (
    Measured,
    RunKind,
    RunOptions,
    finished_later,
)
from torquebench.campaign.registering import (
    FittedFile,
    RegisteredCalibration,
    register_calibration,
    registered_choices,
)
from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.procedures import StaircaseResult, calibrate
from torquebench.procedures.resuming import Resumption
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry, RunFolder
from torquebench.station import Station
from torquebench.station.matching import compensation_for


@dataclass(frozen=True)
class FittedCalibration:
    """Models fitted to a calibration, and the name of the one to be put into use.

    `active` is None if the calibration contradicts itself, or if a newer calibration exists.
    """

    models: tuple[FittedModel, ...]
    active: str | None


@dataclass(frozen=True)
class FinishedCalibration:
    """A calibration with the models that were fitted to it, all registered.

    Parameters
    ----------
    active : str or None
        Name of the model that was put into use; None if its calibration contradicts itself.
    """

    measured: Measured[StaircaseResult]
    fitted: tuple[FittedModel, ...]
    registered: RegisteredCalibration
    active: str | None


def measure_calibration(
    station: Station,
    side: Side,
    profile: Profile,
    resumption: Resumption | None = None,
    **options: Unpack[RunOptions],
) -> Measured[StaircaseResult]:
    """Calibrate one module against the calibrator, or resume an interrupted calibration.

    Parameters
    ----------
    side : {"input", "output"}
    resumption : Resumption, optional
        State of the interrupted calibration; see `campaign.resuming`.
    **options
        See `RunOptions`.

    Raises
    ------
    LimitError, InterlockError
        The run is refused before anything moves.
    RunAbortedError
        Somebody ended the run.
    SignalFault, BenchError
        The run failed; the bench is without torque.
    """
    before, unreadable = _model_in_use(station, side)
    if unreadable:
        progress = options.get("progress", NO_PROGRESS)
        progress.start(Message("Comparing the {side} module with its model in use", side))
        progress.finish(unreadable)
        options["metadata"] = {**options.get("metadata", {}), "remarks": [unreadable]}
    return CALIBRATION.measure(station, side, profile, resumption, before, **options)


def _model_in_use(station: Station, side: Side) -> tuple[ActiveChain | None, str]:
    """Return a module's model in use, or None and why it can't be read ("" if there is none)."""
    description, counter = station.description, station.drivers.counter.clock_identity
    serial, registry = description.module(side).transducer.serial, station.registry
    try:
        if registry.patiently(lambda: entry_in_use(registry, serial, counter)) is None:
            return None, ""
        return compensation_for(registry, description, counter, side), ""
    except TorquebenchError as error:
        return None, not_compared(error)


def calibration_fit(
    registry: Registry,
    measured: Measured[StaircaseResult],
    choices: Sequence[ModelChoice],
    progress: Progress = NO_PROGRESS,
) -> partial[list[FittedModel]]:
    """Return a function that fits the models to a calibration, here or in another process.

    The function takes `progress` and `title` like `fit_models`.
    """
    data = measured.result.data
    with finished_later(measured.record.run_id, progress) as report_retry:
        before = registry.patiently(lambda: model_in_use(registry, data), told=report_retry)
    return partial(
        fit_models,
        data,
        choices,
        effects=recorded_effects(measured.record.metadata, data),
        limits=measured.profile.plausibility,
        before=before,
    )


def _fit_as_begun(
    registry: Registry, measured: Measured[StaircaseResult], progress: Progress
) -> FittedCalibration:
    """Fit the models that a run's record names; none is put into use after a newer calibration."""
    data, folder = measured.result.data, RunFolder(measured.record.folder)
    choices, active = registered_choices(measured.record.metadata)
    newest = registry.calibrations(data.transducer_serial, limit=1)
    if newest and newest[0].performed > datetime.fromisoformat(folder.manifest["sealed"]):
        active = None
    fit = calibration_fit(registry, measured, choices, progress)
    title = Message("Fitting the {side} module", data.side)
    return FittedCalibration(tuple(fit(progress=progress, title=title)), active)


def _register(
    registry: Registry, measured: Measured[StaircaseResult], fitted: FittedCalibration
) -> FinishedCalibration:
    """Store the fitted models' files and enter the calibration into the registry."""
    data, run_id, active = measured.result.data, measured.record.run_id, fitted.active
    if any(item.contradictions for item in fitted.models if item.name == active):
        active = None
    files = [
        FittedFile(
            item.name,
            item.model.kind,
            registry.root / "models" / f"{run_id}-{item.name}.json",
            metrics := fit_metrics(item, data),
            item.contradictions,
            described_model(item.model, data, metrics, item.effects, item.contradictions),
        )
        for item in fitted.models
    ]
    folder = RunFolder(measured.record.folder)
    registered = register_calibration(registry, folder, files, active)
    return FinishedCalibration(measured, fitted.models, registered, active)


def _describe(done: FinishedCalibration) -> Message:
    """Return the numbers under which a calibration and its models are registered, in a sentence."""
    entry = done.registered.calibration
    return Message(
        "run {run_id} is registered as calibration-{calibration_id} with {numbers}",
        done.measured.record.run_id,
        entry.calibration_id,
        ", ".join(f"model-{model.model_id}" for model in done.registered.models.values()),
    )


CALIBRATION = RunKind(
    "calibrate-{side}",
    lambda side: Message("Calibrating the {side} module", side),
    calibrate,
    _fit_as_begun,
    _register,
    _describe,
)
