"""From a calibration in the registry to the record of its certificate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench import __version__
from torquebench.calibration import (
    RAW,
    CalibrationData,
    CalibrationRecord,
    Profile,
    ReferenceStandard,
    assign_nominal,
    find_deviations,
    refuse_deviations,
)
from torquebench.campaign.fitting import model_title
from torquebench.compensation import CompensationModel, load_model
from torquebench.errors import InputError, RecordError
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
from torquebench.reports.certificate.record import (
    CertificateRecord,
    DeviationStatement,
    Item,
    Method,
    Party,
    Reference,
    VerificationSummary,
)
from torquebench.reports.certificate.results import evaluate_results

__all__ = ["DEFAULT_TOLERANCE_PERCENT_FS", "Issue", "build_record", "calibration_of", "run_data"]

DEFAULT_TOLERANCE_PERCENT_FS = 0.1
"""0.1 % of full scale: what the published instrument reaches (doi 10.1177/00202940221103308)."""


@dataclass(frozen=True)
class Issue:
    """What the person who issues a certificate decides.

    Parameters
    ----------
    authorised_by : sequence of str
        Who answers for it; at least one.
    laboratory, customer : Party
        An unnamed laboratory is accepted for a simulated calibration only.
    languages : sequence of str
        The first one leads.
    tolerance_percent_fs : float
        What the statement of conformity is about.
    number : str
        Unique number; made from transducer and calibration where empty.
    issued : datetime.date, optional
        Today (UTC) by default.
    draft : bool
        Whether this only shows what a certificate would state; nobody has to answer for it, and
        it can't be registered.
    """

    authorised_by: Sequence[str]
    laboratory: Party = field(default_factory=Party)
    customer: Party = field(default_factory=Party)
    languages: Sequence[str] = ("en",)
    tolerance_percent_fs: float = DEFAULT_TOLERANCE_PERCENT_FS
    number: str = ""
    issued: date | None = None
    draft: bool = False


def calibration_of(registry: Registry, run_id: str) -> CalibrationEntry:
    """Return the calibration that a run measured.

    Raises
    ------
    RecordError
        Where there is no such run, or it isn't sealed.
    InputError
        Where the run measured no calibration.
    """
    run = registry.run(run_id)
    if run.finished is None:
        raise RecordError(
            f"run {run_id} isn't sealed: it still runs, or was interrupted",
            "a completed, sealed run",
            "let it end, or calibrate again",
        )
    for entry in registry.calibrations():
        if entry.run_id == run_id:
            return entry
    raise InputError(
        f"run {run_id} ({run.kind}, {run.status}) has no registered calibration",
        "a completed calibration run",
        "list them with `torquebench records list calibrations`",
    )


def run_data(folder: RunFolder) -> CalibrationData:
    """Return the points that a calibration run has left.

    Raises
    ------
    RecordError
        Where the run has none.
    """
    results = folder.results
    if not isinstance(results, Mapping) or not isinstance(results.get("data"), Mapping):
        raise RecordError(f"{folder.path} holds no points of a calibration", "a calibration run")
    try:
        return CalibrationData(**results["data"])
    except TypeError as error:
        raise RecordError(f"{folder.path}: results.json has other columns ({error})") from error


def build_record(
    registry: Registry, calibration: CalibrationEntry, issue: Issue
) -> CertificateRecord:
    """Return everything that the certificate of a calibration states.

    The run folder and the model file are checked against their registered hashes, and the points
    against the profile that the run followed.

    Parameters
    ----------
    registry : Registry
    calibration : CalibrationEntry
        Measured by a run of this registry, with a model fitted to it.
    issue : Issue

    Raises
    ------
    RecordError
        Where the run isn't sealed, was changed, or departs from its profile in a way that the
        profile refuses; where no model was fitted; where the number is taken.
    InputError
        Where nobody authorises, a real laboratory has no name, or the calibration has no run.
    """
    names = _authorising(issue)
    source = _Source.of(registry, calibration)
    data = source.data
    _require_laboratory(source, issue)
    deviations = find_deviations(source.calibration_record(), source.profile)
    refuse_deviations(deviations)
    results = evaluate_results(
        data,
        source.model,
        reference_percent=source.reference.expanded_uncertainty_percent,
        tolerance_percent_fs=issue.tolerance_percent_fs,
    )
    earlier = registry.certificates(calibration.calibration_id)
    return CertificateRecord(
        number=issue.number or _number(calibration, len(earlier)),
        languages=tuple(dict.fromkeys(issue.languages)),
        draft=issue.draft,
        simulated=source.run.simulated or data.simulated,
        laboratory=issue.laboratory,
        customer=issue.customer,
        item=_item(registry, source, calibration),
        method=_method(source, calibration),
        reference=source.reference,
        calibrated_from=source.run.started.date(),
        calibrated_to=(source.run.finished or source.run.started).date(),
        issued=issue.issued or datetime.now(UTC).date(),
        run_id=source.run.run_id,
        calibration_id=calibration.calibration_id,
        temperature_c=_extremes(data.temperature_c),
        compensation=model_title(source.model_entry.kind, source.model.get_params(deep=False)),
        results=results.rows,
        budget=results.budget,
        budget_step=results.budget_step,
        budget_freedom=results.budget_freedom,
        conformity=results.conformity,
        verification=_verification(registry, source.model_entry),
        deviations=tuple(
            DeviationStatement(each.clause, each.found, each.allowed) for each in deviations
        ),
        measured_by=calibration.measured_by or source.run.operator,
        checked_by=_checked_by(registry, calibration),
        authorised_by=names,
        software_version=__version__,
        files=source.files(calibration),
        registry_head=str(registry.head()),
        supersedes=earlier[0].number if earlier else "",
    )


@dataclass(frozen=True, eq=False)
class _Source:
    """What a certificate rests on, read once and checked."""

    run: RunSummary
    folder: RunFolder
    data: CalibrationData
    profile: Profile
    reference: Reference
    model_entry: ModelEntry
    model: CompensationModel
    unsettled: int
    changes: tuple[str, ...]

    @classmethod
    def of(cls, registry: Registry, calibration: CalibrationEntry) -> "_Source":
        if calibration.run_id is None:
            raise InputError(
                f"calibration-{calibration.calibration_id} is a table from elsewhere",
                "a calibration that a run of this registry has measured",
            )
        run = registry.run(calibration.run_id)
        folder = RunFolder.open(run.folder)
        if not folder.sealed or not run.manifest_sha256:
            raise RecordError(
                f"run {run.run_id} isn't sealed ({run.status})",
                "a completed, sealed run",
                "let it end, or recover it; a certificate states completed runs only",
            )
        changes = tuple(folder_changes(run.folder, run.manifest_sha256))
        if changes:
            raise RecordError(
                f"run {run.run_id}: {'; '.join(changes)} (clause deviations.changed_record)",
                "a record as it was sealed",
                "restore it from a backup, or calibrate again",
            )
        if run.status != "completed":
            raise RecordError(f"run {run.run_id} was {run.status}: {run.reason}", "a completed run")
        start = next(document for _, document in folder.documents("start"))
        profile = Profile.model_validate(start["profile"]["settings"])
        data = assign_nominal(run_data(folder), profile)
        model_entry = _model_of(registry, calibration)
        return cls(
            run=run,
            folder=folder,
            data=data,
            profile=profile,
            reference=_reference(registry, calibration, folder),
            model_entry=model_entry,
            model=load_model(model_entry.check_file()).model,
            unsettled=int(folder.results.get("unsettled", 0)),
            changes=(
                *_changed_points(data, calibration),
                *calibration_changes(registry, calibration.calibration_id),
            ),
        )

    def calibration_record(self) -> CalibrationRecord:
        """Return the calibration as its profile is held against it."""
        return CalibrationRecord(
            data=self.data,
            performed=self.run.started,
            reference=ReferenceStandard(
                serial=self.reference.serial,
                certificate_number=self.reference.certificate_number,
                due=self.reference.due,
                expanded_uncertainty_percent=self.reference.expanded_uncertainty_percent,
            ),
            unsettled=self.unsettled,
            changes=self.changes,
        )

    def files(self, calibration: CalibrationEntry) -> dict[str, str]:
        """Return the hashes of what the certificate rests on."""
        listed: Mapping[str, Mapping[str, Any]] = self.folder.manifest["files"]
        names = {name: str(entry["sha256"]) for name, entry in sorted(listed.items())}
        return {
            "manifest.json": self.run.manifest_sha256,
            **names,
            self.model_entry.file.name: self.model_entry.file_sha256,
            "calibration points": calibration.data_sha256,
        }


def _authorising(issue: Issue) -> tuple[str, ...]:
    names = tuple(name.strip() for name in issue.authorised_by if name.strip())
    if not (names or issue.draft):
        raise InputError("a certificate that nobody authorises", "a name", "give --authorised-by")
    return names


def _require_laboratory(source: _Source, issue: Issue) -> None:
    if not (source.run.simulated or issue.laboratory.name or issue.draft):
        raise InputError(
            "a certificate of a real calibration without a laboratory",
            "name, city and country of the laboratory",
            "write them into laboratory.toml in the data directory, or give --laboratory FILE",
        )


def _method(source: _Source, calibration: CalibrationEntry) -> Method:
    profile = source.profile
    return Method(
        name=profile.name,
        title=profile.title,
        source=profile.source,
        sha256=calibration.profile_sha256 or profile.sha256,
        verified=profile.verified,
        series=len(set(source.data.series.tolist())),
        points=len(source.data),
        unsettled=source.unsettled,
    )


def _checked_by(registry: Registry, calibration: CalibrationEntry) -> str:
    reviews = registry.reviews("calibrations", calibration.calibration_id)
    return ", ".join(dict.fromkeys(each.checked_by for each in reviews if each.accepted))


def _extremes(values: NDArray[np.float64] | None) -> tuple[float, float] | None:
    return None if values is None else (float(values.min()), float(values.max()))


def _changed_points(data: CalibrationData, calibration: CalibrationEntry) -> tuple[str, ...]:
    if data.sha256() == calibration.data_sha256:
        return ()
    return ("the run's points aren't those of the registered calibration",)


def _model_of(registry: Registry, calibration: CalibrationEntry) -> ModelEntry:
    """Return the model of a calibration that is in use, or the latest one fitted to it."""
    fitted = [
        entry
        for entry in registry.models(calibration.transducer_serial)
        if entry.calibration_id == calibration.calibration_id
    ]
    if not fitted:
        raise RecordError(
            f"calibration-{calibration.calibration_id} has no compensation model",
            "a model that was fitted to it",
            "fit one, since the certificate states results before and after compensation",
        )
    used = [each.model_id for each in registry.activations(calibration.transducer_serial)]
    for model_id in reversed(used):
        for entry in fitted:
            if entry.model_id == model_id:
                return entry
    return fitted[0]


def _reference(registry: Registry, calibration: CalibrationEntry, folder: RunFolder) -> Reference:
    serial = calibration.standard_serial
    described = next(
        (each for each in registry.equipment("calibrator") if each.serial == serial),
        Equipment("calibrator", serial),
    )
    bench = folder.metadata.get("bench")
    # What the bench description said when the run was made, not what it says today.
    standard: Mapping[str, Any] = (bench or {}).get("calibrator", {})
    if standard.get("serial") != serial:
        standard = {**described.details, "model": described.model}
    report = _report(registry, serial)
    percent = report.expanded_uncertainty_percent or standard.get("expanded_uncertainty_percent")
    if percent is None:
        raise RecordError(
            f"nobody has stated the uncertainty of the standard {serial}",
            "its expanded uncertainty (k = 2) in % of the range",
            "enter its certificate",
        )
    return Reference(
        serial=serial,
        model=str(standard.get("model", described.model)),
        certificate_number=report.number or str(standard.get("certificate_number", "")),
        laboratory=report.laboratory,
        expanded_uncertainty_percent=float(percent),
        performed=report.performed or _day(standard.get("certificate_date")),
        due=report.due,
    )


def _report(registry: Registry, serial: str) -> Report:
    reports = registry.reports(serial)
    return reports[0] if reports else Report("calibrator", serial, "")


def _day(text: object) -> date | None:
    try:
        return date.fromisoformat(str(text))
    except ValueError:
        return None


def _item(registry: Registry, source: _Source, calibration: CalibrationEntry) -> Item:
    serial = calibration.transducer_serial
    known = next(
        (each for each in registry.equipment("transducer") if each.serial == serial),
        Equipment("transducer", serial),
    )
    return Item(
        serial=serial,
        manufacturer=known.manufacturer,
        model=known.model,
        side=source.data.side,
        bench=source.run.bench,
        counter_identity=calibration.counter_identity,
        range_nm=calibration.range_nm,
    )


def _verification(registry: Registry, entry: ModelEntry) -> VerificationSummary | None:
    """Return what the latest verification of the model found."""
    found = registry.verifications(entry.model_id)
    if not found:
        return None
    latest = found[-1]
    models = {model["name"]: model for model in latest.summary["models"]}
    raw = models.pop(RAW)
    compensated = next(iter(models.values()))
    averaged = compensated.get("averaged")
    truth = compensated.get("against_truth")
    return VerificationSummary(
        performed=latest.performed.date(),
        points=int(latest.summary["points"]),
        groups=int(latest.summary["groups"]),
        worst_before_nm=float(raw["against_standard"]["worst_nm"]),
        worst_after_nm=float(compensated["against_standard"]["worst_nm"]),
        # Averaged errors of a simulated bench refer to the true torque, which no standard shows.
        averaged_after_nm=None if averaged is None or truth else float(averaged["worst_nm"]),
        data_sha256=latest.data_sha256,
    )


def _number(calibration: CalibrationEntry, issued_before: int) -> str:
    serial = "".join(mark if mark.isalnum() else "-" for mark in calibration.transducer_serial)
    again = f"-{issued_before + 1}" if issued_before else ""
    return f"TB-{calibration.performed:%Y}-{serial}-{calibration.calibration_id:04d}{again}"
