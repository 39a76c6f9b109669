"""One module from calibration to verified, registered models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
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
    feature_columns,
    fit_metrics,
    model_title,
    store_model,
)
from torquebench.campaign.measuring import Measured, operator_name
from torquebench.campaign.results import CompensationResult, DenseSweep, ModuleResult
from torquebench.compensation import (
    CompensationModel,
    features,
)
from torquebench.procedures import StaircaseResult
from torquebench.records import MANIFEST, CalibrationEntry, ModelEntry, sha256_of_file
from torquebench.station import Station

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
    station: Station,
    measured: Measured[StaircaseResult],
    profile: Profile,
    fitted: Sequence[FittedModel],
    active: str | None,
) -> RegisteredCalibration:
    """Register a calibration, store its models beside the runs and put one of them into use.

    Parameters
    ----------
    station : Station
    measured : Measured
        The calibration.
    profile : Profile
        That it followed.
    fitted : sequence of FittedModel
        Models of it.
    active : str or None
        Name of the one that the module compensates with from now on; None leaves that open.
    """
    registry, result = station.registry, measured.result
    entry = registry.add_calibration(
        result.data,
        run_id=measured.record.run_id,
        standard_serial=result.standard_serial,
        profile_name=profile.name,
        profile_sha256=profile.sha256,
        measured_by=operator_name(),
        due=propose_due_date(datetime.now(UTC), None, longest_days=profile.valid_days),
        files={MANIFEST: sha256_of_file(measured.record.folder / MANIFEST)},
        summary=_summary(measured),
    )
    models = {}
    for item in fitted:
        metrics = fit_metrics(item, result.data)
        path = station.data_dir / "models" / f"{measured.record.run_id}-{item.name}.json"
        store_model(path, item.model, result.data, metrics, item.effects)
        models[item.name] = registry.add_model(
            entry, kind=item.model.kind, file=path, side=result.data.side, metrics=metrics
        )
    if active is not None:
        registry.activate(models[active].model_id, reason="recommended by the calibration")
    return RegisteredCalibration(entry, models)


def _summary(measured: Measured[StaircaseResult]) -> dict[str, Any]:
    """Return what the registry keeps of a calibration beside its points."""
    result, known = measured.result, measured.record.metadata
    summary: dict[str, Any] = {"unsettled points": result.unsettled}
    if known.get("resumes"):
        summary |= {
            "goes on with": ", ".join(known["resumes"]),
            "points of earlier runs": known["points_of_earlier_runs"],
            "measured here from series": known["resumed_at_series"],
        }
        if known["damaged_points"]:
            summary["measured again for damage to the record"] = "; ".join(known["damaged_points"])
    if result.placement is not None:
        summary["placement"] = result.placement.sentence
    return summary


def register_verification(
    station: Station,
    registered: RegisteredCalibration,
    result: VerificationResult,
    run_id: str,
) -> None:
    """Register what a verification found, for each model beside the raw reading."""
    for name, entry in registered.models.items():
        part = replace(result, models=(result.of(RAW), result.of(name)))
        station.registry.add_verification(
            entry.model_id, part, run_id=run_id, measured_by=operator_name()
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
    """Put together how every model does on the verification and on the dense sweep.

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
    result = verify(data, {item.name: item.chain for item in fitted})
    raw = CompensationResult(
        name=RAW,
        title=model_title(RAW),
        recommended=False,
        model=None,
        fit_seconds=0.0,
        torque_nm=data.reading_nm,
        verification=result.of(RAW),
        **_dense(None, dense, data.range_nm),
    )
    models = [
        CompensationResult(
            name=item.name,
            title=item.title,
            recommended=item.name == recommended,
            model=item.model,
            fit_seconds=item.seconds,
            torque_nm=item.chain.torque(data.readings()).value_nm,
            verification=result.of(item.name),
            **_dense(item.model, dense, data.range_nm),
        )
        for item in fitted
    ]
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
    model: CompensationModel | None, sweep: DenseSweep | None, range_nm: float
) -> dict[str, Any]:
    if sweep is None:
        return {}
    torque = sweep.reading_nm
    if model is not None:
        X = features(sweep.reading_nm, sweep.branch, 0, 0.0, CALIBRATION_TEMPERATURE_C)
        torque = model.predict(X[:, : feature_columns(model)])
    errors: ErrorSummary = summarise_errors(torque, sweep.true_torque_nm, range_nm)
    return {"dense_torque_nm": torque, "dense": errors}


CALIBRATION_TEMPERATURE_C = 23.0
"""Temperature that the noise-free sweep is computed at."""
