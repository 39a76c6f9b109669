"""Register measured runs: convert the content of sealed folders to entries of the registry.

The entry of a calibration depends on the folder only, whether it is registered right after its run,
days later, from an external table, or in a rebuilt registry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from torquebench.atomic_write import private_folder
from torquebench.calibration import (
    AdaptiveRound,
    CalibrationData,
    Contradiction,
    Placement,
    Profile,
    propose_due_date,
)
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.measuring import Measured
from torquebench.compensation import RECOMMENDED, StoredModel, save_model
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.procedures import StaircaseResult
from torquebench.records import (
    MANIFEST,
    REGISTERS,
    CalibrationEntry,
    ModelEntry,
    Registry,
    RunFolder,
    sha256_of_file,
)
from torquebench.records.signatures import Signature, operator_name
from torquebench.station import RunRecord, enter_run

__all__ = [
    "FittedFile",
    "RegisteredCalibration",
    "calibration_entry",
    "read_measured",
    "register_calibration",
    "registered_choices",
    "registers_calibration",
    "run_data",
    "run_profile",
]


@dataclass(frozen=True)
class FittedFile:
    """A stored model that is registered with its calibration.

    `name` is the name of the choice, `kind` the kind of the model; `metrics` are the errors of its
    cross-validation; `stored` is written to the file, which otherwise exists.
    """

    name: str
    kind: str
    path: Path
    metrics: Mapping[str, Any] = field(default_factory=dict)
    contradictions: Sequence[Contradiction] = ()
    stored: StoredModel | None = None


@dataclass(frozen=True)
class RegisteredCalibration:
    """A registered calibration with its fitted models.

    Parameters
    ----------
    models : mapping of str to ModelEntry
        Entries of the models by the names of their choices.
    """

    calibration: CalibrationEntry
    models: Mapping[str, ModelEntry]


def registers_calibration(models: Sequence[ModelChoice], active: str | None) -> dict[str, Any]:
    """Return the metadata of a calibration's run for finishing and resuming it later.

    Parameters
    ----------
    models : sequence of ModelChoice
        Models to be fitted to the calibration.
    active : str or None
        Name of the model to be put into use.
    """
    return {REGISTERS: {"models": [model.specification for model in models], "active": active}}


def registered_choices(metadata: Mapping[str, Any]) -> tuple[list[ModelChoice], str | None]:
    """Return the models in the record of a calibration's run, and the one to be put into use."""
    wanted = metadata.get(REGISTERS) or {"models": [{"name": RECOMMENDED}], "active": RECOMMENDED}
    return [ModelChoice(**choice) for choice in wanted["models"]], wanted["active"]


def register_calibration(
    registry: Registry,
    folder: RunFolder,
    models: Sequence[FittedFile],
    active: str | None = None,
    **remarks: str,
) -> RegisteredCalibration:
    """Register a calibration with its models, and put one of them into use.

    This is one transaction; if the run's calibration is already registered, it is returned.

    Parameters
    ----------
    folder : RunFolder
        The sealed run.
    active : str or None
        Name of the model to be activated, unless the calibration contradicts itself.
    **remarks : str
        Further entries of the summary.
    """
    with registry.writing():
        enter_run(registry, folder)
        before = registry.calibration_of_run(folder.run_id)
        if before is not None:
            entry = registry.calibration(before)
            entries = {model.file.name: model for model in registry.models(calibration_id=before)}
            return RegisteredCalibration(
                entry,
                {
                    model.name: entries[model.path.name]
                    for model in models
                    if model.path.name in entries
                },
            )
        entry = registry.add_calibration(calibration_entry(folder, **remarks))
        registered = {}
        for model in models:
            if model.stored is not None:
                private_folder(model.path.parent)
                save_model(model.path, model.stored, private=True)
            registered[model.name] = registry.add_model(
                entry,
                kind=model.kind,
                file=model.path,
                side=run_data(folder).side,
                metrics=model.metrics,
                contradictions=model.contradictions,
            )
        if active is not None and not registered[active].contradictions:
            registry.activate(
                registered[active].model_id,
                reason="recommended by the calibration",
                signature=_signature(folder, automatic=True),
            )
    return RegisteredCalibration(entry, registered)


def calibration_entry(folder: RunFolder, **remarks: str) -> CalibrationEntry:
    """Return the registry entry for the calibration in a sealed run."""
    data, profile, metadata = run_data(folder), run_profile(folder), folder.metadata
    results, manifest = folder.results, folder.manifest
    performed = datetime.fromisoformat(manifest["sealed"])
    if "table" in metadata:  # measured externally, before this run
        start = _start(folder)
        performed = datetime.fromtimestamp(float(start["time"]), performed.tzinfo)
    listed = [name for name in (MANIFEST, "table.csv") if (folder.path / name).is_file()]
    return CalibrationEntry.of_points(
        data,
        performed=performed,
        run_id=folder.run_id,
        standard_serial=str(results.get("standard_serial", "")),
        measured_by=str(metadata.get("operator") or operator_name()),
        due=propose_due_date(performed, None, longest_days=profile.valid_days),
        profile_name=profile.name,
        profile_sha256=profile.sha256,
        files={name: sha256_of_file(folder.path / name) for name in listed},
        summary={
            **_summary(metadata, results),
            **{name.replace("_", " "): text for name, text in remarks.items()},
        },
        signature=_signature(folder),
    )


def _signature(folder: RunFolder, *, automatic: bool = False) -> Signature | None:
    """Return how a run was begun; None where it doesn't tell.

    With `automatic` the signature of a decision that follows from the run without a person.
    """
    stored = folder.metadata.get("signature")
    signature = None if stored is None else Signature.restored(stored)
    if automatic and (signature is None or signature.kind == "typed"):
        return Signature.typed(automatic=True)
    return signature


def _summary(metadata: Mapping[str, Any], results: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the registry stores of a calibration beside its points."""
    if "table" in metadata:
        return {"table": metadata["table"], "entered by": metadata["entered_by"]}
    summary: dict[str, Any] = {"unsettled points": results.get("unsettled", 0)}
    if metadata.get("resumes"):
        summary |= {
            "goes on with": ", ".join(metadata["resumes"]),
            "points of earlier runs": metadata["points_of_earlier_runs"],
            "measured here from series": metadata["resumed_at_series"],
        }
        if metadata["damaged_points"]:
            summary["measured again because their record was damaged"] = "; ".join(
                metadata["damaged_points"]
            )
    if results.get("placement"):
        summary["placement"] = _placement(results["placement"]).sentence
    return summary


def run_data(folder: RunFolder) -> CalibrationData:
    """Return the points of a calibration run.

    Raises
    ------
    RecordError
        The run's folder has no calibration data.
    """
    results = folder.results
    if not isinstance(results, Mapping) or not isinstance(results.get("data"), Mapping):
        raise RecordError(
            Message("{path} holds no points of a calibration", folder.path), "a calibration run"
        )
    try:
        # A bench subtracts its zeros; runs of version 0.2.0 don't state it.
        measured = folder.metadata.get("kind") != "calibration-table"
        return CalibrationData(**{"tared": measured, **results["data"]})
    except TypeError as error:
        raise RecordError(
            Message("{path}: results.json has other columns ({error})", folder.path, error)
        ) from error


def _start(folder: RunFolder) -> dict[str, Any]:
    """Return the start document of a run."""
    for _, document in folder.documents("start"):
        return document
    raise RecordError(
        Message("{path} has no document of its start", folder.path), "a run that was begun"
    )


def run_profile(folder: RunFolder) -> Profile:
    """Return the profile of a calibration run, options included."""
    start = _start(folder)
    if "profile" not in start:
        raise RecordError(Message("{path} has no profile", folder.path), "a calibration run")
    return Profile.model_validate(start["profile"]["settings"])


def read_measured(folder: RunFolder) -> Measured[StaircaseResult]:
    """Return what a completed calibration, check or verification measured.

    Raises
    ------
    RecordError
        The folder holds no such result.
    """
    data, results, metadata = run_data(folder), folder.results, folder.metadata
    try:
        placement = results.get("placement")
        result = StaircaseResult(
            data=data,
            unsettled=int(results["unsettled"]),
            standard_serial=str(results["standard_serial"]),
            placement=None if placement is None else _placement(placement),
        )
    except (AttributeError, KeyError, TypeError) as error:
        raise RecordError(
            Message("{path} holds no points of a calibration ({error})", folder.path, error),
            "a calibration run",
        ) from error
    record = RunRecord(
        folder.run_id, str(metadata["kind"]), folder.path, "success", result, metadata=metadata
    )
    return Measured(result, record, run_profile(folder))


def _placement(plain: Mapping[str, Any]) -> Placement:
    rounds = tuple(AdaptiveRound(**entry) for entry in plain["rounds"])
    return Placement(**{**plain, "rounds": rounds})
