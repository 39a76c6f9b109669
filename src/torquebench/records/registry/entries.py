"""Values that the registry accepts and returns, in terms of a calibration laboratory."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file

if TYPE_CHECKING:
    from torquebench.calibration import Contradiction

__all__ = [
    "Activation",
    "Adjustment",
    "Amendment",
    "CalibrationEntry",
    "CertificateEntry",
    "CheckEntry",
    "Component",
    "Equipment",
    "EquipmentKind",
    "ModelEntry",
    "Report",
    "Review",
    "RunSummary",
    "VerificationEntry",
    "Zeroing",
    "archived_at",
    "sha256_of_record",
]

EquipmentKind = Literal[
    "transducer",
    "calibrator",
    "verification-standard",
    "counter",
    "drive",
    "encoder",
    "bench",
    "reducer",
]


@dataclass(frozen=True)
class Equipment:
    """A transducer, standard, counter, drive, encoder, bench or tested reducer.

    Parameters
    ----------
    kind : str
        Kind of equipment.
    serial : str
        Its serial number; of a counter, the identity of its timebase; of a bench, its name.
    manufacturer, model : str
        From its name plate.
    range_nm : float, optional
        Its full scale in N·m.
    details : mapping
        Further data: class, nominal zero, timebase frequency.
    """

    kind: EquipmentKind
    serial: str
    manufacturer: str = ""
    model: str = ""
    range_nm: float | None = None
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Component:
    """A piece of equipment that is fitted into another one.

    Parameters
    ----------
    whole, part : tuple of kind and serial
        The whole, and the part fitted into it.
    role : str
        Role, such as ``"output.transducer"``.
    fitted : datetime.datetime
        Since when.
    """

    whole: tuple[str, str]
    part: tuple[str, str]
    role: str
    fitted: datetime
    fitted_by: str = ""


@dataclass(frozen=True)
class Adjustment:
    """Work on a piece of equipment that may change its indication.

    Parameters
    ----------
    kind, serial : str
        The equipment.
    what : str
        Such as ``"span set"``, ``"repaired"``, ``"model put into use"``.
    before, after : mapping
        Settings or indications before and after, if recorded.
    performed_by, checked_by : str
        The persons who performed and who reviewed it.
    """

    kind: str
    serial: str
    what: str
    performed: datetime
    performed_by: str
    checked_by: str = ""
    reason: str = ""
    before: Mapping[str, Any] = field(default_factory=dict)
    after: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """The certificate of a standard by the laboratory that calibrated it: traceability.

    Parameters
    ----------
    kind, serial : str
        The standard.
    number, laboratory : str
        Of the certificate.
    performed, due : datetime.date, optional
        Day of the calibration, and last day on which it counts.
    valid_nm : tuple of float, optional
        Lowest and highest torque that it covers, in N·m.
    expanded_uncertainty_percent : float, optional
        Largest U (k = 2) of the standard, % of its range. One that is certified as a share of the
        torque has its largest U at full range.
    file : pathlib.Path, optional
        The certificate's file, which is hashed when it is registered.
    """

    kind: EquipmentKind
    serial: str
    number: str
    laboratory: str = ""
    performed: date | None = None
    due: date | None = None
    measured_by: str = ""
    checked_by: str = ""
    valid_nm: tuple[float, float] | None = None
    expanded_uncertainty_percent: float | None = None
    file: Path | None = None
    file_sha256: str = ""


@dataclass(frozen=True)
class Zeroing:
    """The unloaded zero of a transducer.

    Parameters
    ----------
    zero_hz, zero_nm : float
        Frequency, and its deviation from the nominal zero in N·m.
    """

    transducer_serial: str
    performed: datetime
    zero_hz: float
    zero_nm: float
    temperature_c: float | None = None
    run_id: str | None = None
    simulated: bool = False


@dataclass(frozen=True)
class Amendment:
    """An amendment of a record; the record itself isn't changed.

    Parameters
    ----------
    subject, subject_id : str, int
        Table and number of the record that it amends.
    changes : mapping
        Field to its correct value.
    """

    subject: str
    subject_id: int
    amended: datetime
    amended_by: str
    reason: str
    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Review:
    """A review of a record, and its result."""

    subject: str
    subject_id: int
    checked: datetime
    checked_by: str
    accepted: bool
    remark: str


@dataclass(frozen=True)
class RunSummary:
    """One line of the list of runs.

    Parameters
    ----------
    run_id : str
        Identifier and name of the folder.
    kind : str
        Kind of run, such as ``"calibrate-output"``.
    started, finished : datetime.datetime
        In UTC; `finished` is None while the run is open.
    status : str
        ``"running"``, ``"completed"``, ``"aborted"``, ``"failed"`` or ``"interrupted"``.
    simulated : bool
        Whether it ran on the simulated bench.
    folder : pathlib.Path
        The run's folder.
    """

    run_id: str
    kind: str
    started: datetime
    simulated: bool
    software_version: str
    folder: Path
    finished: datetime | None = None
    status: str = "running"
    reason: str = ""
    side: str = ""
    operator: str = ""
    bench: str = ""
    profile_name: str = ""
    profile_sha256: str = ""
    manifest_sha256: str = ""


@dataclass(frozen=True)
class CalibrationEntry:
    """One calibration of one chain.

    Parameters
    ----------
    calibration_id : int
        Its number in the registry.
    run_id : str or None
        The run that measured it; None for an external table.
    transducer_serial, counter_identity : str
        The chain that it is valid for.
    standard_serial, measured_by : str
        The reference standard, and the person who measured.
    valid_nm : tuple of float
        Lowest and highest torque that it is valid for, in N·m.
    due : datetime.date or None
        When the chain is to be calibrated again.
    files : mapping of str to str
        SHA-256 of the files that hold it, by their names.
    """

    calibration_id: int
    run_id: str | None
    transducer_serial: str
    counter_identity: str
    performed: datetime
    range_nm: float
    points: int
    data_sha256: str
    profile_name: str
    profile_sha256: str
    simulated: bool
    summary: Mapping[str, Any]
    standard_serial: str = ""
    measured_by: str = ""
    valid_nm: tuple[float, float] = (0.0, 0.0)
    due: date | None = None
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ModelEntry:
    """One fitted model and its file.

    Parameters
    ----------
    model_id, calibration_id : int
        Its number, and its calibration's.
    kind : str
        Kind of model, such as ``"polynomial"``.
    file : pathlib.Path
        The model file.
    file_sha256 : str
        Hash of the file when it was registered.
    transducer_serial, counter_identity : str
        The chain that it is valid for.
    """

    model_id: int
    calibration_id: int
    kind: str
    file: Path
    file_sha256: str
    range_nm: float
    side: str
    transducer_serial: str
    counter_identity: str
    metrics: Mapping[str, Any]
    created: datetime
    simulated: bool

    @property
    def contradictions(self) -> "tuple[Contradiction, ...]":
        """Contradictions of the calibration, because of which the model shouldn't be activated."""
        if "contradictions" not in self.metrics:
            return ()
        from torquebench.calibration import Contradiction  # not imported for lists of models

        return tuple(Contradiction(**each) for each in self.metrics["contradictions"])

    def check_file(self) -> Path:
        """Return the path of the model file after checking that it is still the one registered.

        Raises
        ------
        RecordError
            Where the file is missing or was changed.
        """
        if not self.file.is_file():
            raise RecordError(
                Message("model file {file} is missing", self.file),
                "",
                "restore it, or calibrate again",
            )
        if sha256_of_file(self.file) != self.file_sha256:
            raise RecordError(
                Message("model file {file} was changed after it was registered", self.file),
                Message("SHA-256 {sha256}", self.file_sha256),
                "restore it, or calibrate again",
            )
        return self.file


@dataclass(frozen=True)
class Activation:
    """A model put into use for a chain, or (model_id None) compensation taken out of use."""

    model_id: int | None
    transducer_serial: str
    counter_identity: str
    activated: datetime
    operator: str
    reason: str


@dataclass(frozen=True)
class VerificationEntry:
    """Result of a verification for one model; `summary` holds its numbers."""

    model_id: int
    run_id: str | None
    performed: datetime
    data_sha256: str
    simulated: bool
    summary: Mapping[str, Any]
    measured_by: str = ""


@dataclass(frozen=True)
class CheckEntry:
    """A quick check of a chain against the check standard.

    Parameters
    ----------
    verdict : str
        ``"pass"``, ``"conditionalPass"``, ``"conditionalFail"`` or ``"fail"``.
    worst_percent_fs, tolerance_percent_fs : float
        Largest error, and the tolerance, in % of full scale.
    """

    transducer_serial: str
    performed: datetime
    verdict: str
    worst_percent_fs: float
    tolerance_percent_fs: float
    simulated: bool
    standard_serial: str = ""
    model_id: int | None = None
    run_id: str | None = None
    measured_by: str = ""
    summary: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class CertificateEntry:
    """An issued certificate, as stored, listed, exported and sent.

    Parameters
    ----------
    number : str
        Its unique number.
    authorised_by : str
        Who answers for it.
    files : mapping of str to str
        SHA-256 by file name.
    summary : mapping
        Summary of its statements: see `of_record`.
    supersedes : str
        Number of the certificate that it replaces; empty for a first one.
    superseded_by : str
        Number of the one that replaces it, once there is one.
    """

    number: str
    calibration_id: int
    issued: datetime
    authorised_by: str
    files: Mapping[str, str]
    summary: Mapping[str, Any] = field(default_factory=dict)
    supersedes: str = ""
    superseded_by: str = ""

    @classmethod
    def of_record(
        cls,
        record: Mapping[str, Any],
        files: Mapping[str, str],
        archive: str,
        *,
        issued: datetime,
        calibration_id: int,
        **more: str,
    ) -> Self:
        """Return the entry of a certificate from its record.

        Parameters
        ----------
        record : mapping
            The content of the certificate's JSON file.
        files : mapping of str to str
            SHA-256 by file name.
        archive : str
            Folder of its files, as `archive` has it.
        issued : datetime.datetime
            When it was entered, with time zone.
        calibration_id : int
            Of the calibration that it states, in this registry.
        **more : str
            Further entries of the summary.
        """
        conformity = record["conformity"] or {}
        summary = {
            "record_sha256": sha256_of_record(record),
            "languages": record["languages"],
            "simulated": record["simulated"],
            "unreviewed": record.get("unreviewed", []),
            "verdict": conformity.get("verdict"),
            "tolerance_percent_fs": conformity.get("tolerance_percent_fs"),
            "archive": archive,
            "profile": record["method"]["name"],
            "profile_sha256": record["method"]["sha256"],
            "deviations": [each["clause"] for each in record["deviations"]],
            **more,
        }
        return cls(
            number=record["number"],
            calibration_id=calibration_id,
            issued=issued,
            authorised_by=", ".join(record["authorised_by"]),
            files=files,
            summary=summary,
            supersedes=record["supersedes"],
        )

    @property
    def archive(self) -> str:
        """Folder of its files, as a path of its own or within the data directory."""
        return archived_at(self.number, self.summary)


def archived_at(number: str, summary: Mapping[str, Any]) -> str:
    """Return the folder in which the files of a certificate were put when it was issued.

    Examples
    --------
    >>> archived_at("TB-1", {})
    'certificates/TB-1'
    """
    return str(summary.get("archive", f"certificates/{number}"))


def sha256_of_record(record: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a certificate's record, whichever way its JSON is laid out."""
    text = json.dumps(record, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
