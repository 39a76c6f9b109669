"""Results of jobs about compensation, as values and JSON for pages and clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torquebench.calibration import (
    CalibrationData,
    ErrorSummary,
    VerificationResult,
    summarise_errors,
)
from torquebench.campaign.bench_chains import check_standard
from torquebench.campaign.checking import judge_check
from torquebench.campaign.fitting import FittedModel, model_title
from torquebench.chain import MeasuringChain
from torquebench.compensation import CompensationModel, NetworkModel
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.panel.service.jobs.details import (
    CalibrationDetails,
    CalibrationPoints,
    FittedModelDetails,
    TrainingCurve,
    VerificationDetails,
    VerifiedModelDetails,
)
from torquebench.panel.service.jobs.values import JobResult
from torquebench.records import CalibrationEntry, ModelEntry, RunFolder
from torquebench.reports.certificate import run_data
from torquebench.station import Station

__all__ = [
    "calibration_data",
    "calibration_result",
    "errors_of",
    "fit_details",
    "models_of",
    "verification_result",
]


def calibration_result(
    entry: CalibrationEntry,
    data: CalibrationData,
    fitted: Sequence[FittedModel],
    model_ids: Mapping[str, int],
    unsettled: int | None = None,
) -> JobResult:
    """Describe a calibration's errors, before and after each model."""
    best = min(fitted, key=lambda item: errors_of(item, data).worst_percent_fs, default=None)
    judged = ""
    if best is not None:
        judged = Message(
            "; largest residual of {title}: {worst_nm:.3g} N·m",
            best.title,
            errors_of(best, data).worst_nm,
        )
    raw = summarise_errors(data.reading_nm, data.standard_nm, data.range_nm)
    if any(item.contradictions for item in fitted):
        judged = "; the points contradict each other, the model or the last calibration"
    return JobResult(
        headline=Message(
            "{count} points; the raw reading is wrong by up to {worst_nm:.3g} N·m{found}.",
            len(data),
            raw.worst_nm,
            judged,
        ),
        simulated=data.simulated,
        run_ids=(str(entry.run_id),),
        calibration_id=entry.calibration_id,
        model_ids=model_ids,
        details=fit_details(data, fitted, model_ids, unsettled),
    )


def errors_of(item: FittedModel, data: CalibrationData) -> ErrorSummary:
    """Return a model's errors at the points it was fitted to."""
    torque = item.chain.torque(data.readings())
    return summarise_errors(torque.value_nm, data.standard_nm, data.range_nm)


def fit_details(
    data: CalibrationData,
    fitted: Sequence[FittedModel],
    model_ids: Mapping[str, int],
    unsettled: int | None = None,
) -> CalibrationDetails:
    """Return tables and curves of a calibration and its models."""
    return CalibrationDetails(
        side=data.side,
        range_nm=data.range_nm,
        points=CalibrationPoints(data.reading_nm, data.standard_nm, data.branch, data.series),
        raw=summarise_errors(data.reading_nm, data.standard_nm, data.range_nm),
        models={
            item.name: FittedModelDetails(
                model_id=model_ids.get(item.name),
                title=item.title,
                kind=item.model.kind,
                torque_nm=item.chain.torque(data.readings()).value_nm,
                summary=errors_of(item, data),
                remarks=item.remarks,
                contradictions=item.contradictions,
                parameters={} if item.choice is None else item.choice.parameters,
                rising_only=item.choice is not None and item.choice.rising_only,
                training_curve=_training(item.model),
            )
            for item in fitted
        },
        unsettled=unsettled,
    )


def _training(model: CompensationModel) -> TrainingCurve | None:
    """Return the training curve of a network; None for any other model."""
    if not isinstance(model, NetworkModel) or not model.training_curve_.size:
        return None
    return TrainingCurve(*model.training_curve_.T)


def calibration_data(station: Station, calibration_id: int) -> tuple[CalibrationEntry, Any]:
    """Return a calibration and its points.

    Raises
    ------
    RecordError
        It isn't registered, has no run, or its run was changed.
    """
    entry = station.registry.calibration(calibration_id)
    if entry.run_id is None:
        raise RecordError(
            Message("calibration {number} comes from a table", calibration_id),
            "a calibration of this bench",
        )
    data = run_data(RunFolder(station.registry.run(entry.run_id).folder))
    if data.sha256() != entry.data_sha256:
        raise RecordError(
            Message("the points of calibration {number} were changed", calibration_id),
            "as recorded",
        )
    return entry, data


def models_of(station: Station, entry: CalibrationEntry) -> dict[str, ModelEntry]:
    """Return the registered models of a calibration by the names that verifications use."""
    return {
        f"model-{model.model_id}": model
        for model in station.registry.models(entry.transducer_serial)
        if model.calibration_id == entry.calibration_id
    }


def verification_result(
    metadata: Mapping[str, Any],
    entry: CalibrationEntry,
    models: Mapping[str, MeasuringChain],
    data: CalibrationData,
    result: VerificationResult,
    *,
    run_id: str,
    tolerance_percent_fs: float,
    seed: int | None = None,
) -> JobResult:
    """Judge every model at the points of a verification, by the metadata of its run."""
    standard = check_standard(metadata, data)
    details: dict[str, VerifiedModelDetails] = {}
    for name in ("raw", *models):
        judged = judge_check(
            data,
            models.get(name),
            standard=standard,
            tolerance_percent_fs=tolerance_percent_fs,
        )
        details[name] = VerifiedModelDetails(
            model_id=None if name == "raw" else int(name.removeprefix("model-")),
            title=_title(models.get(name)),
            verdict=judged.verdict,
            result=result.of(name),
            error_nm=judged.torque.value_nm - data.standard_nm,
            expanded_uncertainty_nm=judged.torque.expanded_uncertainty_nm,
            not_in_u=judged.missing,
        )
    best = min(models, key=lambda name: result.of(name).against_standard.worst_nm)
    worst = result.of(best).against_standard
    return JobResult(
        headline=Message(
            "{count} fresh points: {title} is within {worst_nm:.3g} N·m "
            "({worst_percent_fs:.3g} % FS).",
            len(data),
            details[best].title,
            worst.worst_nm,
            worst.worst_percent_fs,
        ),
        verdict=details[best].verdict.value,
        simulated=data.simulated,
        run_ids=(run_id,),
        calibration_id=entry.calibration_id,
        model_ids={name: int(name.removeprefix("model-")) for name in models},
        details=VerificationDetails(
            side=data.side,
            range_nm=data.range_nm,
            tolerance_percent_fs=tolerance_percent_fs,
            seed=seed,
            standard_nm=data.standard_nm,
            group=data.series,
            best=best,
            models=details,
        ),
    )


def _title(chain: MeasuringChain | None) -> str:
    if chain is None:
        return model_title("raw")
    model = chain.model
    return model_title(model.kind, model.kind_parameters)
