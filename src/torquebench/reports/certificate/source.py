"""Data of a certificate: a calibration's run, points, profile, standard and model."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

from torquebench.bench.description import stated_uncertainty
from torquebench.calibration import (
    CalibrationData,
    CalibrationRecord,
    Profile,
    ReferenceStandard,
    assign_nominal,
)
from torquebench.campaign.calibration_comparison import model_of_calibration
from torquebench.campaign.registering import run_data
from torquebench.campaign.registering import run_profile as run_profile
from torquebench.chain import MeasuringChain, load_chain
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import (
    CalibrationEntry,
    Equipment,
    ModelEntry,
    Registry,
    Report,
    RunFolder,
    RunSummary,
    calibration_changes,
    folder_changes,
)
from torquebench.records.runs.time_check import times_of_run
from torquebench.reports.certificate.record import Reference
from torquebench.reports.certificate.static import resolution_of


@dataclass(frozen=True, eq=False)
class Source:
    """The checked data from which a certificate is built."""

    run: RunSummary
    folder: RunFolder
    data: CalibrationData
    profile: Profile
    reference: Reference
    model_entry: ModelEntry | None
    chain: MeasuringChain | None
    unsettled: int
    changes: tuple[str, ...]

    @classmethod
    def of(
        cls, registry: Registry, calibration: CalibrationEntry, model_id: int | None = None
    ) -> "Source":
        """Read and check the data of a calibration's certificate.

        The model is the active one or the latest, unless another one is requested.

        Raises
        ------
        RecordError
            Where the run isn't sealed, was changed, or wasn't completed.
        InputError
            Where the calibration has no run.
        """
        if calibration.run_id is None:
            raise InputError(
                Message(
                    "calibration-{calibration_id} is an external table", calibration.calibration_id
                ),
                "a calibration that a run of this registry measured",
                "enter the table with `torquebench records import`",
            )
        run = registry.run(calibration.run_id)
        folder = RunFolder.open(run.folder)
        if not folder.sealed or not run.manifest_sha256:
            raise RecordError(
                Message("run {run_id} isn't sealed ({status})", run.run_id, run.status),
                "a completed, sealed run",
                "wait for its end, or recover it; only completed runs can be certified",
            )
        changes = tuple(folder_changes(run.folder, run.manifest_sha256))
        if changes:
            raise RecordError(
                Message(
                    "run {run_id}: {changes} (clause deviations.changed_record)",
                    run.run_id,
                    "; ".join(changes),
                ),
                "the record as it was sealed",
                "restore it from a backup, or calibrate again",
            )
        if run.status != "completed":
            raise RecordError(
                Message("run {run_id} was {status}: {reason}", run.run_id, run.status, run.reason),
                "a completed run",
            )
        profile = run_profile(folder)
        data = assign_nominal(run_data(folder), profile)
        if model_id is None:
            model_entry = model_of_calibration(registry, calibration)
        else:
            model_entry = registry.model(model_id)
        return cls(
            run=run,
            folder=folder,
            data=data,
            profile=profile,
            reference=_reference(registry, calibration, folder, data),
            model_entry=model_entry,
            chain=None if model_entry is None else load_chain(model_entry.check_file()),
            unsettled=int(folder.results.get("unsettled", 0)),
            changes=(
                *_changed_points(data, calibration),
                *([times_of_run(run)] if times_of_run(run) else []),
                *calibration_changes(registry, calibration.calibration_id),
            ),
        )

    def calibration_record(self) -> CalibrationRecord:
        """Return the calibration in the form that is compared with its profile."""
        return CalibrationRecord(
            data=self.data,
            performed=self.run.started,
            reference=ReferenceStandard(
                serial=self.reference.serial,
                certificate_number=self.reference.certificate_number,
                due=self.reference.due,
            ),
            unsettled=self.unsettled,
            changes=self.changes,
        )

    def files(self, calibration: CalibrationEntry) -> dict[str, str]:
        """Return the hashes of all files on which the certificate is based."""
        listed: Mapping[str, Mapping[str, Any]] = self.folder.manifest["files"]
        names = {name: str(entry["sha256"]) for name, entry in sorted(listed.items())}
        entry = self.model_entry
        return {
            "manifest.json": self.run.manifest_sha256,
            **names,
            **({} if entry is None else {entry.file.name: entry.file_sha256}),
            "calibration points": calibration.data_sha256,
        }

    @property
    def stated_resolution_nm(self) -> float | None:
        """Resolution stated with a table, N·m; None for a run."""
        stated = self.folder.results.get("resolution_nm")
        return None if stated is None else float(stated)

    @property
    def resolution_nm(self) -> float:
        """Resolution of the indication in N·m, as stated or estimated from the noise."""
        stated = self.stated_resolution_nm
        return resolution_of(self.data) if stated is None else stated


def _changed_points(data: CalibrationData, calibration: CalibrationEntry) -> tuple[str, ...]:
    if data.sha256() == calibration.data_sha256:
        return ()
    return ("the run's points aren't those of the registered calibration",)


def _reference(
    registry: Registry, calibration: CalibrationEntry, folder: RunFolder, data: CalibrationData
) -> Reference:
    serial = calibration.standard_serial
    known = registry.equipment("calibrator", serial)
    described = next(iter(known), Equipment("calibrator", serial))
    bench = folder.metadata.get("bench")
    # The bench description or table at the time of the run applies, not the present one.
    standard: Mapping[str, Any] = (bench or {}).get("calibrator", {})
    if standard.get("serial") != serial:
        standard = {**described.details, "model": described.model}
    report = _report(registry, serial, calibration.performed.date())
    stated: Mapping[str, Any] | None = folder.metadata.get("standard")
    if stated is not None:
        standard, report = stated, _stated_report(stated)
    relative = standard.get("expanded_uncertainty_of") == "torque"
    percent = standard.get("expanded_uncertainty_percent")
    if not relative:
        percent = report.expanded_uncertainty_percent or percent
    if percent is None:
        raise RecordError(
            Message("no stated uncertainty of the standard {serial}", serial),
            "its expanded uncertainty (k = 2) in % of the range",
            "enter its certificate",
        )
    number = str(standard.get("certificate_number", ""))
    certified = None
    if (standard.get("certified") or {}).get(data.side) and report.number in ("", number):
        certified = stated_uncertainty(standard, data.side, data.range_nm)
        largest = 100.0 * certified.largest_nm(data.range_nm) / data.range_nm
        percent = float(f"{largest:.3g}")
    return Reference(
        serial=serial,
        model=str(standard.get("model", described.model)),
        certificate_number=report.number or number,
        laboratory=report.laboratory,
        expanded_uncertainty_percent=float(percent),
        performed=report.performed or _day(standard.get("certificate_date")),
        due=report.due,
        of_range=not relative or certified is not None,
        certified=certified,
    )


def _report(registry: Registry, serial: str, day: date) -> Report:
    """Return the certificate of a standard that was valid on a day."""
    reports = registry.reports(serial)
    had = [each for each in reports if each.performed is None or each.performed <= day]
    return (had or reports or [Report("calibrator", serial, "")])[0]


def _stated_report(stated: Mapping[str, Any]) -> Report:
    """Return the standard's certificate as stated with a table."""
    return Report(
        "calibrator",
        str(stated["serial"]),
        str(stated["certificate_number"]),
        laboratory=str(stated["laboratory"]),
        performed=_day(stated["performed"]),
        due=_day(stated["due"]),
    )


def _day(text: object) -> date | None:
    try:
        return date.fromisoformat(str(text))
    except ValueError:
        return None
