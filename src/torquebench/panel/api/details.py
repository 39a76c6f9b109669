"""Types of `details` of a job's result, by the kind of the job."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict
from pydantic.json_schema import models_json_schema

from torquebench.bench.roles import Side
from torquebench.calibration import ErrorSummary
from torquebench.calibration.plausibility import Contradiction
from torquebench.calibration.verification import ModelVerification
from torquebench.compensation.repeats import NoiseFloor

__all__ = ["DETAILS", "details_schemas"]

Numbers = list[float | None]


class CalibrationPoints(BaseModel):
    """The points of a calibration, in measuring order."""

    reading_nm: Numbers
    standard_nm: Numbers
    branch: list[int]
    series: list[int]


class TrainingCurve(BaseModel):
    """RMS of the residuals of a network's training, by epoch."""

    epoch: Numbers
    rms_nm: Numbers


class FittedModelDetails(BaseModel):
    """A fitted model, and its errors at the fitted points."""

    model_id: int | None
    title: str
    kind: str
    torque_nm: Numbers
    summary: ErrorSummary
    remarks: list[str]
    contradictions: list[Contradiction]
    parameters: dict[str, Any]
    rising_only: bool
    training_curve: TrainingCurve | None = None


class CalibrationDetails(BaseModel):
    """Of "calibrate", "resume-calibration", "fit", and "finish-run" of a calibration."""

    side: Side | str
    range_nm: float
    points: CalibrationPoints
    raw: ErrorSummary
    models: dict[str, FittedModelDetails]
    unsettled: int | None = None


class ComparedModel(BaseModel):
    """One kind of model by cross-validation."""

    name: str
    title: str
    worst_nm: float | None
    rms_nm: float | None
    worst_averaged_nm: float | None
    worst_percent_fs: float | None
    rms_percent_fs: float | None
    worst_percent_reading: float | None
    effective_parameters: float | None
    fit_time_s: float | None
    complexity: int
    mean_square_difference: float | None
    standard_error: float | None
    reason: str


class ComparisonDetails(BaseModel):
    """Of "compare-models"."""

    scores: list[ComparedModel]
    best: str
    sentence: str
    refused: dict[str, str]
    noise: NoiseFloor | None
    steps: int
    folds: int


class VerifiedModelDetails(BaseModel):
    """Errors of a model, or of the raw reading, at fresh points."""

    model_id: int | None
    title: str
    verdict: str
    result: ModelVerification
    error_nm: Numbers
    expanded_uncertainty_nm: Numbers


class VerificationDetails(BaseModel):
    """Of "verify": each model under "model-" and its number, and the reading under "raw"."""

    side: Side | str
    range_nm: float
    tolerance_percent_fs: float
    seed: int | None
    standard_nm: Numbers
    group: list[int]
    best: str
    models: dict[str, VerifiedModelDetails]


class ZeroOfSide(BaseModel):
    """The zero of one side, and its deviation from the nominal one."""

    frequency_hz: float
    zero_nm: float


class RecordingDetails(BaseModel):
    """Of "record"; `trigger` states in words what started it."""

    model_config = ConfigDict(extra="forbid")

    seconds: float
    before_s: float
    name: str
    note: str
    trigger: str


class ZeroDetails(BaseModel):
    """Of "zero": a side that wasn't requested is missing."""

    model_config = ConfigDict(extra="forbid")

    input: ZeroOfSide | None = None
    output: ZeroOfSide | None = None


class CheckDetails(BaseModel):
    """Of "check": each point with its verdict; U contains the check standard."""

    side: Side
    tolerance_percent_fs: float
    standard_nm: Numbers
    error_nm: Numbers
    expanded_uncertainty_nm: Numbers
    verdicts: list[str]
    not_in_u: list[str]


class CertificateDetails(BaseModel):
    """Of "certificate"; `unreviewed` lists the unconfirmed statements of every page."""

    files: list[str]
    deviations: list[str]
    languages: list[str]
    supersedes: str
    unreviewed: list[str]


class ReducerQuantity(BaseModel):
    """One result of a test; `limit`, `verdict` and `rule` are empty if there is none."""

    key: str
    title: str
    value: float | None
    expanded_uncertainty: float | None
    unit: str
    limit: str
    verdict: str
    rule: str


class LoopKeyPoint(BaseModel):
    """A point of a torque-angle loop that its evaluation rests on."""

    label: str
    torque_nm: float
    angle_arcmin: float


class TorqueAngleLoop(BaseModel):
    """The first loop: output angle about its middle over torque, both branches."""

    torque_nm: Numbers
    rising_arcmin: Numbers
    falling_arcmin: Numbers
    points: list[LoopKeyPoint]


class ReducerOutcome(BaseModel):
    """Result of one part of a test."""

    name: str
    title: str
    verdict: str
    remarks: list[str]
    run_id: str
    quantities: list[ReducerQuantity]
    loop: TorqueAngleLoop | None = None


class ReducerTestDetails(BaseModel):
    """Of "reducer-test"; `report` is the run by which its PDF is fetched, empty without one."""

    name: str
    short: bool
    reducer_name: str
    serial: str
    report: str
    outcomes: list[ReducerOutcome]


class StandardReducerPoint(BaseModel):
    """Certified friction against measured friction at one speed."""

    speed_rpm: float
    known_nm: float
    known_u_nm: float
    measured_nm: float
    error_nm: float
    error_percent: float
    spread_nm: float
    spread_percent: float


class StandardReducerDetails(BaseModel):
    """Of "standard-reducer"."""

    reducer: str
    certificate: str
    compensation: str
    tolerance_percent_fs: float
    error_percent_fs: float
    repeatability_percent_fs: float
    points: list[StandardReducerPoint]


DETAILS: tuple[type[BaseModel], ...] = (
    CalibrationDetails,
    ComparisonDetails,
    VerificationDetails,
    CheckDetails,
    CertificateDetails,
    ReducerTestDetails,
    StandardReducerDetails,
    RecordingDetails,
    ZeroDetails,
)
"""Kinds of jobs with details; others have none, and "zero" has none for a side that wasn't zeroed.
"""


def details_schemas() -> tuple[list[dict[str, str]], dict[str, Any]]:
    """Return references to the schemas of details, and the schemas with what they refer to."""
    _, found = models_json_schema(
        [(model, "validation") for model in DETAILS],
        ref_template="#/components/schemas/{model}",
    )
    references = [{"$ref": f"#/components/schemas/{model.__name__}"} for model in DETAILS]
    return references, found["$defs"]
