"""Details of a job's result, by the kind of the job: as the job states them, as JSON holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import WithJsonSchema

from torquebench.bench.roles import Side
from torquebench.calibration import ErrorSummary
from torquebench.calibration.plausibility import Contradiction
from torquebench.calibration.verification import ModelVerification
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.compensation.repeats import NoiseFloor
from torquebench.compensation.selection import ModelScore
from torquebench.reducers.standard_reducer import FrictionCheckPoint
from torquebench.uncertainty import Verdict

__all__ = [
    "CalibrationDetails",
    "CalibrationPoints",
    "CertificateDetails",
    "CheckDetails",
    "ComparedModel",
    "ComparisonDetails",
    "Details",
    "FittedModelDetails",
    "LoopKeyPoint",
    "RecordingDetails",
    "ReducerOutcome",
    "ReducerTestDetails",
    "StandardReducerDetails",
    "TorqueAngleLoop",
    "TrainingCurve",
    "VerificationDetails",
    "VerifiedModelDetails",
    "ZeroDetails",
    "ZeroOfSide",
]

_NUMBER = {"anyOf": [{"type": "number"}, {"type": "null"}]}
Numbers: TypeAlias = Annotated[Any, WithJsonSchema({"type": "array", "items": _NUMBER})]
"""An array or a sequence of numbers; null where there is none."""
Integers: TypeAlias = Annotated[
    Any, WithJsonSchema({"type": "array", "items": {"type": "integer"}})
]


@dataclass(frozen=True)
class CalibrationPoints:
    """The points of a calibration, in measuring order."""

    reading_nm: Numbers
    standard_nm: Numbers
    branch: Integers
    series: Integers


@dataclass(frozen=True)
class TrainingCurve:
    """RMS of the residuals of a network's training, by epoch."""

    epoch: Numbers
    rms_nm: Numbers


@dataclass(frozen=True)
class FittedModelDetails:
    """A fitted model, and its errors at the fitted points."""

    model_id: int | None
    title: str
    kind: str
    torque_nm: Numbers
    summary: ErrorSummary
    remarks: Sequence[str]
    contradictions: Sequence[Contradiction]
    parameters: Mapping[str, Any]
    rising_only: bool
    training_curve: TrainingCurve | None


@dataclass(frozen=True)
class CalibrationDetails:
    """Of "calibrate", "resume-calibration", "fit", and "finish-run" of a calibration."""

    side: Side | str
    range_nm: float
    points: CalibrationPoints
    raw: ErrorSummary
    models: Mapping[str, FittedModelDetails]
    unsettled: int | None = None


@dataclass(frozen=True)
class ComparedModel(ModelScore):
    """One kind of model by cross-validation."""

    title: str = ""


@dataclass(frozen=True)
class ComparisonDetails:
    """Of "compare-models"."""

    scores: Sequence[ComparedModel]
    best: str
    sentence: str
    refused: Mapping[str, str]
    noise: NoiseFloor | None
    steps: int
    folds: int


@dataclass(frozen=True)
class VerifiedModelDetails:
    """Errors of a model, or of the raw reading, at fresh points."""

    model_id: int | None
    title: str
    verdict: Verdict
    result: ModelVerification
    error_nm: Numbers
    expanded_uncertainty_nm: Numbers
    not_in_u: Sequence[str]


@dataclass(frozen=True)
class VerificationDetails:
    """Of "verify": each model under "model-" and its number, and the reading under "raw"."""

    side: Side | str
    range_nm: float
    tolerance_percent_fs: float
    seed: int | None
    standard_nm: Numbers
    group: Integers
    best: str
    models: Mapping[str, VerifiedModelDetails]


@dataclass(frozen=True)
class ZeroOfSide:
    """The zero of one side, and its deviation from the nominal one."""

    frequency_hz: float
    zero_nm: float


@dataclass(frozen=True)
class RecordingDetails:
    """Of "record"; `trigger` states in words what started it."""

    seconds: float
    before_s: float
    name: str
    note: str
    trigger: str


@dataclass(frozen=True)
class ZeroDetails:
    """Of "zero": a side that wasn't requested is null."""

    input: ZeroOfSide | None
    output: ZeroOfSide | None


@dataclass(frozen=True)
class CheckDetails:
    """Of "check": each point with its verdict; U contains the check standard."""

    side: Side
    tolerance_percent_fs: float
    standard_nm: Numbers
    error_nm: Numbers
    expanded_uncertainty_nm: Numbers
    verdicts: Sequence[Verdict]
    not_in_u: Sequence[str]


@dataclass(frozen=True)
class CertificateDetails:
    """Of "certificate"; `unreviewed` lists the unconfirmed statements of every page."""

    files: Sequence[str]
    deviations: Sequence[str]
    languages: Sequence[str]
    supersedes: str
    unreviewed: Sequence[str]


@dataclass(frozen=True)
class LoopKeyPoint:
    """A point of a torque-angle loop that its evaluation rests on."""

    label: str
    torque_nm: float
    angle_arcmin: float


@dataclass(frozen=True)
class TorqueAngleLoop:
    """The first loop: output angle about its middle over torque, both branches."""

    torque_nm: Numbers
    rising_arcmin: Numbers
    falling_arcmin: Numbers
    points: Sequence[LoopKeyPoint]


@dataclass(frozen=True)
class ReducerOutcome:
    """Result of one part of a test."""

    name: str
    title: str
    verdict: Verdict
    remarks: Sequence[str]
    run_id: str
    quantities: Sequence[ReducerTestQuantity]
    loop: TorqueAngleLoop | None


@dataclass(frozen=True)
class ReducerTestDetails:
    """Of "reducer-test"; `report` is the run by which its PDF is fetched, empty without one."""

    name: str
    short: bool
    reducer_name: str
    serial: str
    report: str
    outcomes: Sequence[ReducerOutcome]


@dataclass(frozen=True)
class StandardReducerDetails:
    """Of "standard-reducer"."""

    reducer: str
    certificate: str
    compensation: str
    tolerance_percent_fs: float
    error_percent_fs: float
    repeatability_percent_fs: float
    points: Sequence[FrictionCheckPoint]


Details: TypeAlias = (
    CalibrationDetails
    | ComparisonDetails
    | VerificationDetails
    | CheckDetails
    | CertificateDetails
    | ReducerTestDetails
    | StandardReducerDetails
    | RecordingDetails
    | ZeroDetails
)
"""Of the kinds of jobs with details; others have none."""
