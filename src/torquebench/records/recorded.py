"""A calibration as its sealed run folder holds it: what a certificate is written from."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

from torquebench.calibration import (
    CalibrationData,
    CalibrationRecord,
    Deviation,
    Profile,
    ReferenceStandard,
    find_deviations,
)
from torquebench.errors import RecordError
from torquebench.records.entries import CalibrationEntry
from torquebench.records.integrity import check_rows_of, folder_changes
from torquebench.records.registry import Registry
from torquebench.records.run_folder import RunFolder

__all__ = ["RecordedCalibration", "recorded_calibration"]


@dataclass(frozen=True, eq=False)
class RecordedCalibration:
    """A calibration with everything that its record says of it.

    Parameters
    ----------
    entry : CalibrationEntry
        Its row in the registry.
    record : CalibrationRecord
        Points and circumstances; `record.changes` names what was changed after the fact.
    profile : Profile
        As it was followed, options included.
    metadata : mapping
        What was known before the run: bench, operator, instruments, software version.
    deviations : tuple of Deviation
        Where the calibration departs from its profile.
    """

    entry: CalibrationEntry
    record: CalibrationRecord
    profile: Profile
    metadata: Mapping[str, Any]
    deviations: tuple[Deviation, ...]


def recorded_calibration(registry: Registry, run_id: str) -> RecordedCalibration:
    """Read a calibration back from its run folder, checked against all that was registered.

    Parameters
    ----------
    registry : Registry
        The open registry.
    run_id : str
        The calibration's run.

    Raises
    ------
    RecordError
        Where the run isn't a finished calibration, or its folder is gone.
    """
    run = registry.run(run_id)
    entry = next((each for each in registry.calibrations() if each.run_id == run_id), None)
    if entry is None or run.status != "completed":
        raise RecordError(
            f"run {run_id} ({run.kind}, {run.status}) isn't a finished calibration",
            "a run of `torquebench calibrate`",
            "see `torquebench records list calibrations`",
        )
    folder = RunFolder.open(run.folder)
    results = folder.results
    if not isinstance(results, dict) or "data" not in results:
        raise RecordError(f"{run.folder} holds no points", "results.json of a calibration")
    data = CalibrationData(**results["data"])
    changes = [
        *folder_changes(run.folder, run.manifest_sha256),
        *check_rows_of(registry, run_id, entry.calibration_id),
    ]
    if data.sha256() != entry.data_sha256:
        changes.append("the points in results.json aren't those that were registered")
    start = next((document for _, document in folder.documents("start")), {})
    profile = _profile(start, entry)
    record = CalibrationRecord(
        data=data,
        performed=run.started,
        reference=_reference(folder.metadata, results, registry),
        unsettled=int(results.get("unsettled", 0)),
        changes=tuple(changes),
    )
    return RecordedCalibration(
        entry, record, profile, folder.metadata, find_deviations(record, profile)
    )


def _profile(start: Mapping[str, Any], entry: CalibrationEntry) -> Profile:
    settings = start.get("profile", {}).get("settings")
    if settings is None:
        raise RecordError(
            f"run {entry.run_id} doesn't say which profile it followed", "a profile's settings"
        )
    return Profile.model_validate(settings)


def _reference(
    metadata: Mapping[str, Any], results: Mapping[str, Any], registry: Registry
) -> ReferenceStandard:
    """Return the standard as the bench's description named it when the run began."""
    serial = str(results.get("standard_serial", ""))
    bench = metadata.get("bench", {})
    standards = [bench.get("calibrator", {}), bench.get("verification_standard", {})]
    found: Mapping[str, Any] = next(
        (each for each in standards if each.get("serial") == serial), {}
    )
    reports = registry.reports(serial)
    due = found.get("certificate_due")
    stated = date.fromisoformat(due) if isinstance(due, str) else None
    return ReferenceStandard(
        serial=serial,
        certificate_number=str(found.get("certificate_number", "")),
        due=stated or next((each.due for each in reports if each.due), None),
        expanded_uncertainty_percent=found.get("expanded_uncertainty_percent"),
    )
