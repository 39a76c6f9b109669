"""Records as values for pages and clients, without paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from torquebench.panel.service.live.markers import Marker
from torquebench.records import (
    Activation,
    CalibrationEntry,
    CertificateEntry,
    ModelEntry,
    Review,
    RunSummary,
    VerificationEntry,
)


@dataclass(frozen=True)
class RunPage:
    """A part of the list of runs, and their total number; `doubts` reports a wrong clock."""

    runs: tuple[RunSummary, ...]
    total: int
    offset: int
    doubts: tuple[str, ...]


@dataclass(frozen=True)
class RunTable:
    """The events of one stream of a run, with one column per field.

    Parameters
    ----------
    stream : str
    units : mapping of column to str
    columns : mapping of column to list
        Columns by field; the device's name is left out if that is unambiguous.
    """

    stream: str
    units: Mapping[str, str]
    columns: Mapping[str, Sequence[Any]]

    @property
    def errors(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """The standard's torques and the readings' errors, N·m; None without a standard."""
        if not {"reading_nm", "standard_nm"} <= self.columns.keys():
            return None
        pairs = list(zip(self.columns["standard_nm"], self.columns["reading_nm"], strict=True))
        standard = tuple(float(standard) for standard, _ in pairs)
        return standard, tuple(float(reading) - float(standard) for standard, reading in pairs)


@dataclass(frozen=True)
class RunDetail:
    """All data of one run for display.

    Parameters
    ----------
    run : RunSummary
    metadata : mapping
        Metadata at the start.
    results : object
        Its results, as JSON; None without results.
    tables : tuple of RunTable
    calibration_id : int or None
        The calibration that it measured.
    changes : tuple of str
        Changes since the run was sealed; empty if it is intact.
    annotations : tuple of Marker
        Annotations that people made while it was recorded.
    """

    run: RunSummary
    metadata: Mapping[str, Any]
    results: Any
    tables: tuple[RunTable, ...]
    calibration_id: int | None
    changes: tuple[str, ...]
    annotations: tuple[Marker, ...]


@dataclass(frozen=True)
class CalibrationDetail:
    """A calibration with its models, verifications, reviews and certificates.

    `signed_sha256` is the present hash of the records that a signature covers.
    """

    calibration: CalibrationEntry
    models: tuple[ModelEntry, ...]
    verifications: tuple[VerificationEntry, ...]
    reviews: tuple[Review, ...]
    certificates: tuple[CertificateEntry, ...]
    activations: tuple[Activation, ...]
    signed_sha256: str


@dataclass(frozen=True)
class ErrorCurve:
    """The error of a chain at a calibration's points, raw and compensated by a model.

    Parameters
    ----------
    calibration_id : int
    title : str
    standard_nm, raw_error_nm : tuple of float
        Torque of the standard, and reading minus standard.
    branch : tuple of int
        Branch: +1 increasing, -1 decreasing torque.
    model_id : int or None
    model_error_nm : tuple of float
        Compensated torque minus standard; empty without a model.
    """

    calibration_id: int
    title: str
    standard_nm: tuple[float, ...]
    raw_error_nm: tuple[float, ...]
    branch: tuple[int, ...]
    model_id: int | None
    model_error_nm: tuple[float, ...]


@dataclass(frozen=True)
class UnfinishedView:
    """An unfinished run.

    Parameters
    ----------
    run_id, kind : str
    state : {"left open", "sealed", "measured", "interrupted"}
        State of the run: an "interrupted" one must be resumed on its bench, others can be finished
        without measuring.
    found, remedy : str
        Description of the state, and the command that finishes the run.
    """

    run_id: str
    kind: str
    state: str
    found: str
    remedy: str


@dataclass(frozen=True)
class InterruptedView:
    """An interrupted calibration.

    Parameters
    ----------
    run_id, side, profile : str
    interrupted : datetime.datetime
        When its last point was measured, UTC.
    points, kept, total : int
        Numbers of measured points, of points that are kept, and of all points.
    """

    run_id: str
    side: str
    profile: str
    interrupted: datetime
    points: int
    kept: int
    total: int
