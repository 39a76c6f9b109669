"""What the registry hands in and out: frozen values in the words of a calibration laboratory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from torquebench.errors import RecordError
from torquebench.records.files import sha256_of_file

__all__ = [
    "Activation",
    "CalibrationEntry",
    "Instrument",
    "InstrumentKind",
    "ModelEntry",
    "RunSummary",
    "VerificationEntry",
]

InstrumentKind = Literal["transducer", "calibrator", "verification-standard", "counter"]


@dataclass(frozen=True)
class Instrument:
    """A transducer, calibrator, verification standard or counter.

    Parameters
    ----------
    kind : {"transducer", "calibrator", "verification-standard", "counter"}
        What it is.
    serial : str
        Its serial number; of a counter, the identity of its timebase.
    manufacturer, model : str
        As on its plate.
    range_nm : float, optional
        Its full scale in N·m.
    details : mapping
        What else is known: certificate number, class, nominal zero, timebase frequency.
    """

    kind: InstrumentKind
    serial: str
    manufacturer: str = ""
    model: str = ""
    range_nm: float | None = None
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunSummary:
    """One line of the list of runs.

    Parameters
    ----------
    run_id : str
        Identifier and name of the folder.
    kind : str
        What the run did, such as ``"calibrate-output"``.
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
        The run that measured it; None for a table from elsewhere.
    transducer_serial, counter_identity : str
        The chain that it is valid for.
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


@dataclass(frozen=True)
class ModelEntry:
    """One fitted model and its file.

    Parameters
    ----------
    model_id, calibration_id : int
        Its number, and that of the calibration that it was fitted to.
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

    def check_file(self) -> Path:
        """Return the path of the model file after checking that it is still the one registered.

        Raises
        ------
        RecordError
            Where the file is missing or was changed.
        """
        if not self.file.is_file():
            raise RecordError(
                f"model file {self.file} is missing", "", "restore it, or calibrate again"
            )
        if sha256_of_file(self.file) != self.file_sha256:
            raise RecordError(
                f"model file {self.file} was changed after it was registered",
                f"SHA-256 {self.file_sha256}",
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
    """What a verification found for one model; `summary` holds its numbers."""

    model_id: int
    run_id: str | None
    performed: datetime
    data_sha256: str
    simulated: bool
    summary: Mapping[str, Any]
