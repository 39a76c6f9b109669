"""Records in values for pages and clients, without paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date, datetime
from typing import Any

from torquebench.records import (
    Activation,
    CalibrationEntry,
    CertificateEntry,
    ModelEntry,
    Review,
    RunSummary,
    VerificationEntry,
)

__all__ = [
    "CalibrationDetail",
    "CalibrationView",
    "ErrorCurve",
    "ModelView",
    "RunDetail",
    "RunPage",
    "RunTable",
    "RunView",
]


def _same_fields(view: Any, entry: object, **own: Any) -> dict[str, Any]:
    """Return the values of a view's fields: its own, and an entry's of the same names."""
    names = [each.name for each in fields(view) if each.name not in own]
    return {name: getattr(entry, name) for name in names} | own


@dataclass(frozen=True)
class RunView:
    """One line of the list of runs; `doubts` lists implausible times."""

    run_id: str
    kind: str
    side: str
    operator: str
    started: datetime
    finished: datetime | None
    status: str
    reason: str
    simulated: bool
    profile: str
    bench: str
    software_version: str
    doubts: tuple[str, ...]

    @classmethod
    def of(cls, run: RunSummary, doubts: tuple[str, ...] = ()) -> RunView:
        """Omit the location of the run's files."""
        return cls(**_same_fields(cls, run, profile=run.profile_name, doubts=doubts))


@dataclass(frozen=True)
class RunPage:
    """A part of the list of runs, and how many there are in all; `doubts` reports a wrong clock."""

    runs: tuple[RunView, ...]
    total: int
    offset: int
    doubts: tuple[str, ...]


@dataclass(frozen=True)
class RunTable:
    """The events of one stream of a run: a column a field.

    Parameters
    ----------
    stream : str
    units : mapping of column to str
    columns : mapping of column to list
        Without the devices' names where that is unambiguous.
    """

    stream: str
    units: Mapping[str, str]
    columns: Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class RunDetail:
    """Everything about one run that can be shown.

    Parameters
    ----------
    run : RunView
    metadata : mapping
        Metadata at the start.
    results : object
        Its results, as JSON; None without results.
    tables : tuple of RunTable
    calibration_id : int or None
        The calibration that it measured.
    changes : tuple of str
        Changes since the run was sealed; empty if it is intact.
    """

    run: RunView
    metadata: Mapping[str, Any]
    results: Any
    tables: tuple[RunTable, ...]
    calibration_id: int | None
    changes: tuple[str, ...]


@dataclass(frozen=True)
class ModelView:
    """A fitted model, and whether it is in use."""

    model_id: int
    calibration_id: int
    kind: str
    side: str
    transducer_serial: str
    counter_identity: str
    range_nm: float
    created: datetime
    simulated: bool
    metrics: Mapping[str, Any]
    active: bool

    @classmethod
    def of(cls, model: ModelEntry, *, active: bool) -> ModelView:
        """Omit the location of the model's file."""
        return cls(**_same_fields(cls, model, metrics=dict(model.metrics), active=active))


@dataclass(frozen=True)
class CalibrationView:
    """One line of the list of calibrations; `doubts` names an expired standard, wrong times."""

    calibration_id: int
    run_id: str | None
    transducer_serial: str
    counter_identity: str
    standard_serial: str
    performed: datetime
    due: date | None
    measured_by: str
    profile: str
    points: int
    range_nm: float
    simulated: bool
    summary: Mapping[str, Any]
    doubts: tuple[str, ...]

    @classmethod
    def of(cls, entry: CalibrationEntry, doubts: tuple[str, ...] = ()) -> CalibrationView:
        """Leave out hashes and files."""
        own = {"profile": entry.profile_name, "summary": dict(entry.summary), "doubts": doubts}
        return cls(**_same_fields(cls, entry, **own))


@dataclass(frozen=True)
class CalibrationDetail:
    """A calibration with its models, verifications, reviews and certificates."""

    calibration: CalibrationView
    models: tuple[ModelView, ...]
    verifications: tuple[VerificationEntry, ...]
    reviews: tuple[Review, ...]
    certificates: tuple[CertificateEntry, ...]
    activations: tuple[Activation, ...]


@dataclass(frozen=True)
class ErrorCurve:
    """The error of a chain over torque: points of a calibration, raw and after a model.

    Parameters
    ----------
    calibration_id : int
    title : str
    standard_nm, raw_error_nm : tuple of float
        Torque of the standard, and reading minus standard.
    branch : tuple of int
        +1 up, -1 down.
    model_id : int or None
    model_error_nm : tuple of float
        Compensated torque minus standard; empty where no model is chosen.
    """

    calibration_id: int
    title: str
    standard_nm: tuple[float, ...]
    raw_error_nm: tuple[float, ...]
    branch: tuple[int, ...]
    model_id: int | None
    model_error_nm: tuple[float, ...]
