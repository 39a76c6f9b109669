"""Register an external calibration as one sealed record, as if it had been measured by a run."""

from __future__ import annotations

import json
import secrets
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from torquebench.atomic_write import private_folder
from torquebench.calibration import CalibrationData, Profile
from torquebench.campaign.registering import FittedFile, register_calibration
from torquebench.chain import Reference
from torquebench.compensation import StoredModel, save_model
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import (
    CalibrationEntry,
    Equipment,
    ModelEntry,
    Registry,
    Report,
    RunFolder,
    json_text,
)
from torquebench.records.signatures import Signature
from torquebench.uncertainty import CertifiedUncertainty
from torquebench.validation import refuse_future

KIND = "calibration-table"
"""Kind of the run that holds an external table."""


@dataclass(frozen=True)
class ExternalCalibration:
    """Circumstances of an external calibration.

    Parameters
    ----------
    performed : datetime.datetime
        Time of the calibration, with time zone.
    measured_by : str
        Person who performed it.
    place : str
        The bench or the laboratory.
    transducer : Equipment
        The calibrated equipment.
    indicator : str
        Identity of the counter or amplifier that it was read with.
    reference : Report
        The standard and its certificate.
    reference_model : str
        Type of the standard.
    resolution_nm : float
        Resolution of the indication, N·m.
    reference_uncertainty : CertifiedUncertainty or float
        Expanded uncertainty (k = 2) of the standard: over the torque, or in % of the torque.
    """

    performed: datetime
    measured_by: str
    place: str
    transducer: Equipment
    indicator: str
    reference: Report
    reference_model: str
    resolution_nm: float
    reference_uncertainty: CertifiedUncertainty | float


@dataclass(frozen=True)
class RegisteredTable:
    """Entries of a registered table: its run, its calibration, and the model."""

    run_id: str
    calibration: CalibrationEntry
    model: ModelEntry | None


def register_table(
    registry: Registry,
    table: str,
    data: CalibrationData,
    profile: Profile,
    circumstances: ExternalCalibration,
    *,
    operator: str,
    signature: Signature | None = None,
    model: StoredModel | None = None,
    called: str = "table.csv",
    sha256: str,
) -> RegisteredTable:
    """Register a table with its equipment, so that certificates and exports work as for a run.

    The table itself is stored unchanged in a sealed folder beside the runs.

    Parameters
    ----------
    table : str
        Its text.
    data : CalibrationData
        Points of the table, with nominal torques.
    profile : Profile
        Profile that was followed.
    operator : str
        Person who enters the table.
    signature : Signature, optional
        How that person was authenticated; typed on this computer by default.
    model : StoredModel, optional
        A compensation model for these points, which is kept with the day of the calibration.
    called : str, optional
        Name of the table in records.
    sha256 : str
        Hash of the table's file.

    Raises
    ------
    InputError
        A name is missing, or these points are already registered.
    """
    check_circumstances(circumstances)
    serial = circumstances.transducer.serial
    for entry in registry.calibrations(serial):
        if entry.data_sha256 == data.sha256():
            raise InputError(
                Message(
                    "the points of {called} are entered as calibration-{number}",
                    called,
                    entry.calibration_id,
                ),
                "a table that isn't entered yet",
                Message("torquebench certificate calibration-{number}", entry.calibration_id),
            )
    data = replace(data, measured_on=circumstances.performed.date())
    stored = None if model is None else _fitting_model(model, data)
    metadata = _metadata(profile, circumstances, data, operator, signature or Signature.typed())
    metadata |= {"table": called, "table_sha256": sha256}
    writer = RunFolder.create(registry.root / "runs", metadata, kind=KIND)
    with writer:
        _documents(writer, profile, circumstances)
        writer.write_file("table.csv", table)
        writer.write_results(
            {
                "data": replace(data, reference=None),  # the metadata contain the standard
                "unsettled": 0,
                "standard_serial": circumstances.reference.serial,
                "resolution_nm": circumstances.resolution_nm,
            }
        )
        folder = writer.seal()
    models = []
    if stored is not None:
        path = registry.root / "models" / f"{folder.run_id}-{stored.model.kind}.json"
        private_folder(path.parent)
        save_model(path, stored, private=True)
        models.append(FittedFile("model", stored.model.kind, path))
    with registry.writing():
        _register_equipment(registry, circumstances)
        registered = register_calibration(registry, folder, models)
    return RegisteredTable(
        folder.run_id, registered.calibration, next(iter(registered.models.values()), None)
    )


def check_circumstances(circumstances: ExternalCalibration) -> None:
    """Refuse circumstances that don't allow a certificate.

    Raises
    ------
    InputError
        If a name is missing, or the measurement is in the future.
    """
    refuse_future(circumstances.performed)
    calibrated = circumstances.reference.performed
    if calibrated is not None and calibrated > circumstances.performed.date():
        raise InputError(
            Message("a standard that was calibrated on {day}", calibrated.isoformat()),
            Message(
                "on the day of the measurement, {day}, or before",
                f"{circumstances.performed:%Y-%m-%d}",
            ),
            "give the certificate that was valid then",
        )
    for value, what, option in (
        (circumstances.transducer.serial, "the transducer's serial number", "--transducer"),
        (circumstances.indicator, "the counter or amplifier it was read with", "--indicator"),
        (circumstances.reference.serial, "the standard's serial number", "--reference-serial"),
        (circumstances.measured_by, "who measured it", "--measured-by"),
    ):
        if not value:
            raise InputError(
                Message("a calibration to be entered without {what}", what),
                "a name",
                Message("give {option}", option),
            )


def _fitting_model(stored: StoredModel, data: CalibrationData) -> StoredModel:
    """Return a model for these points, with the day of their measurement as its calibration's."""
    provenance = stored.provenance
    if abs(provenance.range_nm - data.range_nm) > 1e-6 * data.range_nm:
        raise InputError(
            Message("a model for ±{range:g} N·m", provenance.range_nm),
            Message("a model for ±{range:g} N·m, the table's range", data.range_nm),
        )
    return replace(stored, provenance=replace(provenance, calibrated_on=str(data.measured_on)))


def _metadata(
    profile: Profile,
    circumstances: ExternalCalibration,
    data: CalibrationData,
    operator: str,
    signature: Signature,
) -> dict[str, Any]:
    """Return the metadata of the run that keeps an external calibration."""
    reference = circumstances.reference
    return {
        "simulated": data.simulated,
        "bench_name": circumstances.place,
        "operator": circumstances.measured_by,
        "entered_by": operator,
        "signature": signature,
        "entered": datetime.now(UTC),
        "side": data.side,
        "profile_name": profile.name,
        "profile_sha256": profile.sha256,
        "counter_identity": circumstances.indicator,
        "standard": {
            "serial": reference.serial,
            "model": circumstances.reference_model,
            "certificate_number": reference.number,
            "laboratory": reference.laboratory,
            "performed": reference.performed,
            "due": reference.due,
            **_stated(circumstances.reference_uncertainty, data),
            **_limits(circumstances.reference_uncertainty, data.reference),
        },
    }


def _stated(uncertainty: CertifiedUncertainty | float, data: CalibrationData) -> dict[str, Any]:
    """Return the fields of a standard's record that `stated_uncertainty` reads."""
    if isinstance(uncertainty, float):
        return {
            "expanded_uncertainty_percent": uncertainty,
            "expanded_uncertainty_of": "torque",
        }
    points = {
        "torque_nm": list(uncertainty.torque_nm),
        "expanded_uncertainty_nm": list(uncertainty.expanded_nm),
    }
    largest = 100.0 * uncertainty.largest_nm(data.range_nm) / data.range_nm
    return {
        "expanded_uncertainty_percent": largest,
        "expanded_uncertainty_of": "range",
        "certified": {data.side: points},
    }


def _limits(
    uncertainty: CertifiedUncertainty | float, reference: Reference | None
) -> dict[str, float | None]:
    """Return the limits of a standard whose uncertainty comes from the table."""
    if reference is None or reference.certified != uncertainty:
        return {}
    return {name: getattr(reference, name) for name in Reference.LIMITS}


def _documents(writer: Any, profile: Profile, circumstances: ExternalCalibration) -> None:
    """Write start and stop documents, as a measured run has them."""
    uid, time_s = secrets.token_hex(8), circumstances.performed.timestamp()
    settings = json.loads(json_text(profile))
    named = {"name": profile.name, "sha256": profile.sha256, "settings": settings}
    writer.document("start", {"uid": uid, "time": time_s, "plan_name": KIND, "profile": named})
    writer.document(
        "stop",
        {"uid": secrets.token_hex(8), "run_start": uid, "time": time_s, "exit_status": "success"},
    )


def _register_equipment(registry: Registry, circumstances: ExternalCalibration) -> None:
    """Register transducer, indicator and, unless it is known, the reference standard."""
    reference = circumstances.reference
    registry.add_equipment(circumstances.transducer)
    registry.add_equipment(Equipment("counter", circumstances.indicator))
    if not registry.equipment("calibrator", reference.serial):
        model = circumstances.reference_model
        registry.add_equipment(Equipment("calibrator", reference.serial, model=model))
