"""One module from calibration to verified, registered models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from torquebench.bench.drivers.base import Side
from torquebench.calibration import (
    RAW,
    ErrorSummary,
    Profile,
    VerificationResult,
    propose_due_date,
    summarise_errors,
    verify,
)
from torquebench.campaign.fitting import (
    FittedModel,
    fit_metrics,
    model_title,
    store_model,
)
from torquebench.campaign.measuring import Measured, operator_name
from torquebench.campaign.results import CompensationResult, DenseSweep, ModuleResult
from torquebench.chain import MeasuringChain, Readings
from torquebench.procedures import StaircaseResult
from torquebench.records import (
    MANIFEST,
    CalibrationEntry,
    ModelEntry,
    Registry,
    RunFolder,
    sha256_of_file,
)
from torquebench.station import RunRecord, Station, enter_run

__all__ = [
    "RegisteredCalibration",
    "dense_sweep",
    "evaluate_module",
    "register_calibration",
    "register_verification",
]

DENSE_POINTS_PER_BRANCH = 1001


@dataclass(frozen=True)
class RegisteredCalibration:
    """A calibration in the registry with the models that were fitted to it.

    Parameters
    ----------
    calibration : CalibrationEntry
    models : mapping of str to ModelEntry
        By the name of the choice.
    """

    calibration: CalibrationEntry
    models: Mapping[str, ModelEntry]


def register_calibration(
    registry: Registry,
    measured: Measured[StaircaseResult],
    profile: Profile,
    fitted: Sequence[FittedModel],
    active: str | None,
) -> RegisteredCalibration:
    """Register a calibration, store its models beside the runs and put one of them into use.

    All of it in one transaction; where the run has a calibration already, that one is returned.

    Parameters
    ----------
    registry : Registry
    measured : Measured
        The calibration; its folder is sealed.
    profile : Profile
        That it followed.
    fitted : sequence of FittedModel
        Models of it.
    active : str or None
        Name of the model to be activated, unless the calibration contradicts itself; None if
        undecided.
    """
    result, run_id, folder = measured.result, measured.record.run_id, measured.record.folder
    performed = datetime.fromisoformat(RunFolder(folder).manifest["sealed"])
    files = {}
    for item in fitted:  # before they are registered
        metrics = fit_metrics(item, result.data)
        files[item.name] = registry.root / "models" / f"{run_id}-{item.name}.json", metrics
    with registry.writing():
        enter_run(registry, RunFolder(folder))
        before = registry.calibration_of_run(run_id)
        if before is not None:
            return _registered(registry, registry.calibration(before))
        for item in fitted:
            path, metrics = files[item.name]
            store_model(
                path,
                item.model,
                result.data,
                metrics,
                item.effects,
                item.contradictions,
                private=True,
            )
        entry = registry.add_calibration(
            result.data,
            performed=performed,
            run_id=run_id,
            standard_serial=result.standard_serial,
            profile_name=profile.name,
            profile_sha256=profile.sha256,
            measured_by=str(measured.record.metadata.get("operator") or operator_name()),
            due=propose_due_date(performed, None, longest_days=profile.valid_days),
            files={MANIFEST: sha256_of_file(folder / MANIFEST)},
            summary=_summary(measured),
        )
        models = {
            item.name: registry.add_model(
                entry,
                kind=item.model.kind,
                file=files[item.name][0],
                side=result.data.side,
                metrics=files[item.name][1],
                contradictions=item.contradictions,
            )
            for item in fitted
        }
        if active is not None and not models[active].contradictions:
            registry.activate(models[active].model_id, reason="recommended by the calibration")
    return RegisteredCalibration(entry, models)


def _registered(registry: Registry, entry: CalibrationEntry) -> RegisteredCalibration:
    """Return a registered calibration with its models by name."""
    models = {
        model.file.stem.removeprefix(f"{entry.run_id}-"): model
        for model in registry.models(calibration_id=entry.calibration_id)
    }
    return RegisteredCalibration(entry, models)


def _summary(measured: Measured[StaircaseResult]) -> dict[str, Any]:
    """Return what the registry stores of a calibration beside its points."""
    result, known = measured.result, measured.record.metadata
    summary: dict[str, Any] = {"unsettled points": result.unsettled}
    if known.get("resumes"):
        summary |= {
            "goes on with": ", ".join(known["resumes"]),
            "points of earlier runs": known["points_of_earlier_runs"],
            "measured here from series": known["resumed_at_series"],
        }
        if known["damaged_points"]:
            summary["measured again because their record was damaged"] = "; ".join(
                known["damaged_points"]
            )
    if result.placement is not None:
        summary["placement"] = result.placement.sentence
    return summary


def register_verification(
    registry: Registry,
    models: Mapping[str, ModelEntry],
    result: VerificationResult,
    record: RunRecord,
) -> None:
    """Register the results of a verification, for each model and the raw reading.

    In one transaction; existing entries of the run aren't changed.
    """
    with registry.writing():
        enter_run(registry, RunFolder(record.folder))
        for name, entry in models.items():
            if any(each.run_id == record.run_id for each in registry.verifications(entry.model_id)):
                continue
            part = replace(result, models=(result.of(RAW), result.of(name)))
            registry.add_verification(
                entry.model_id,
                part,
                run_id=record.run_id,
                performed=datetime.fromisoformat(RunFolder(record.folder).manifest["sealed"]),
                measured_by=str(record.metadata.get("operator") or operator_name()),
            )


def dense_sweep(station: Station, side: Side) -> DenseSweep | None:
    """Sweep the simulated chain densely and without noise; None on a real bench.

    The path goes up and down in both directions, as the calibration did.
    """
    truth = station.devices.context.drivers.truth
    if truth is None:
        return None
    range_nm = station.description.module(side).range_nm
    rising = np.linspace(0.0, range_nm, DENSE_POINTS_PER_BRANCH)
    loop = np.concatenate([rising, rising[-2::-1]])
    path = np.concatenate([loop, -loop[1:]])
    reading_nm, branch = truth.dense_sweep(side, path)
    return DenseSweep(path, reading_nm, branch)


def evaluate_module(
    calibrated: StaircaseResult,
    verified: StaircaseResult,
    profile: Profile,
    fitted: Sequence[FittedModel],
    recommended: str,
    *,
    dense: DenseSweep | None = None,
    run_ids: tuple[str, ...] = (),
) -> tuple[ModuleResult, VerificationResult]:
    """Collect the errors of every model in the verification and in the dense sweep.

    Parameters
    ----------
    calibrated, verified : StaircaseResult
    profile : Profile
        Of the calibration.
    fitted : sequence of FittedModel
    recommended : str
        Name of the model in use.
    dense : DenseSweep, optional
    run_ids : tuple of str
        Runs that hold the raw data.
    """
    data = verified.data
    torques = {item.name: item.chain.torque(data.readings()) for item in fitted}
    result = verify(data, {item.name: item.chain for item in fitted}, torques)
    rows = [
        (each.name, each.title, each.model, each.seconds, torques[each.name].value_nm, each.chain)
        for each in fitted
    ]
    raw, *models = (
        CompensationResult(
            name=name,
            title=title,
            recommended=model is not None and name == recommended,
            model=model,
            fit_seconds=seconds,
            torque_nm=torque_nm,
            verification=result.of(name),
            **_dense(chain, dense, data.range_nm),
        )
        for name, title, model, seconds, torque_nm, chain in (
            (RAW, model_title(RAW), None, 0.0, data.reading_nm, None),
            *rows,
        )
    )
    calibration = calibrated.data
    module = ModuleResult(
        side=data.side,
        range_nm=data.range_nm,
        transducer_serial=data.transducer_serial,
        counter_identity=data.counter_identity,
        profile_name=profile.name,
        profile_hash=profile.sha256,
        calibration=calibration,
        verification=data,
        raw=raw,
        models=tuple(sorted(models, key=lambda model: not model.recommended)),
        dense=dense,
        run_ids=run_ids,
    )
    return module, result


def _dense(
    chain: MeasuringChain | None, sweep: DenseSweep | None, range_nm: float
) -> dict[str, Any]:
    if sweep is None:
        return {}
    torque = sweep.reading_nm
    if chain is not None:
        steady = Readings(
            sweep.reading_nm,
            branch=np.asarray(sweep.branch, dtype=np.float64),
            speed_rpm=0.0,
            acceleration_rad_s2=0.0,
            temperature_c=CALIBRATION_TEMPERATURE_C,
            zero_temperature_c=CALIBRATION_TEMPERATURE_C,
        )
        torque = chain.torque(steady).value_nm
    errors: ErrorSummary = summarise_errors(torque, sweep.true_torque_nm, range_nm)
    return {"dense_torque_nm": torque, "dense": errors}


CALIBRATION_TEMPERATURE_C = 23.0
"""Temperature of the noise-free sweep."""
