"""Import calibration tables of other benches: check and register them.

The input is text. Its size is limited before anything parses it, and neither its content nor its
name is ever used as a path.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.bench.description import CertifiedPoints
from torquebench.calibration import (
    CalibrationData,
    CalibrationRecord,
    Deviation,
    DirectionResults,
    ErrorSummary,
    Profile,
    ReferenceStandard,
    assign_nominal,
    calibration_results,
    check_steps,
    find_deviations,
)
from torquebench.campaign.external_calibration import ExternalCalibration, register_table
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import Day, Moment, Name, Number
from torquebench.panel.service.access.actors import Actor, require
from torquebench.panel.service.problems import BusyError
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.records import Equipment, Registry, Report
from torquebench.reports.certificate import person_among
from torquebench.tables import UNCERTAINTY, Limits, parse_calibration, remarks_in, table_text
from torquebench.uncertainty import CertifiedUncertainty
from torquebench.validation import ConflictError, refuse_future, validated

__all__ = [
    "EnterTableRequest",
    "EnteredTable",
    "TableDirection",
    "TableImport",
    "TableRequest",
    "TableView",
    "read_table",
    "states_reference",
]

LONGEST_TABLE = 512 * 1024
"""Largest table, in characters."""
MOST_LINES = 5000
LONGEST_LINE = 2000
LARGEST_NM = 1e9
MOST_CERTIFIED = 200
"""Largest number of lines of a standard's certificate."""
MOST_DEVIATIONS = 200
"""Largest number of deviations returned; an unsuitable table causes one per line."""
MOST_READ = 4
"""Largest number of tables read at a time, because each occupies a thread of the panel."""
_READ = threading.BoundedSemaphore(MOST_READ)
_LIMITS = Limits(cells=LONGEST_TABLE // 2, mb=16)
"""Limits of an upload; a text of `LONGEST_TABLE` bytes has at most half as many cells."""

Request = TypeVar("Request", bound="TableRequest")

Words = Annotated[str, Field(max_length=120, pattern=r"^[^\x00-\x1f\x7f]*$")]
Needed = Annotated[str, Field(min_length=1, max_length=120, pattern=r"^[^\x00-\x1f\x7f]+$")]


class ReferencePoints(CertifiedPoints):
    """Expanded uncertainty (k = 2) of the standard at its certified torques, N·m."""

    torque_nm: Annotated[list[Number], Field(min_length=1, max_length=MOST_CERTIFIED)]
    expanded_uncertainty_nm: Annotated[list[Number], Field(min_length=1, max_length=MOST_CERTIFIED)]


class TableRequest(BaseModel):
    """A calibration of another bench, as CSV text, and the profile for comparison.

    Without an uncertainty of the standard, that in the table's comments applies.

    The columns are `reading_nm` and `standard_nm`, in measuring order, and `series`, `branch`,
    `direction`, `nominal_nm`, `position_deg`, `temperature_c`, … if they are known.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    content: Annotated[str, Field(min_length=1, max_length=LONGEST_TABLE)]
    profile: Name = "staircase"
    reference_uncertainty_percent: (
        Annotated[Number, Field(gt=0, le=10, description="% of torque or range")] | None
    ) = Field(default=None, description="Expanded uncertainty (k = 2) of the standard, %.")
    reference_uncertainty_of: Literal["torque", "range"] | None = Field(
        default=None, description="What the percentage refers to; required with it."
    )
    reference_points: ReferencePoints | None = Field(
        default=None, description="Table of the standard's certificate, instead of a percentage."
    )
    resolution_nm: Annotated[
        Number, Field(ge=0, le=1e6, description="Resolution of the indication, N·m.")
    ]
    performed: Annotated[Moment, Field(description="When it was measured.")]
    range_nm: Annotated[Number, Field(gt=0, le=LARGEST_NM)] | None = Field(
        default=None, description="Full scale, N·m; the table's own, or its largest torque."
    )
    reference_performed: Day | None = Field(
        default=None, description="Day of the standard's calibration."
    )
    reference_due: Day | None = Field(
        default=None, description="Last day of the standard's certificate."
    )

    @model_validator(mode="after")
    def _one_uncertainty(self) -> Self:
        if not (self.reference_uncertainty_percent is None or self.reference_points is None):
            raise ConflictError(
                "reference_uncertainty_percent",
                "both it and reference_points",
                "a percentage or the table of the standard's certificate",
                "state the standard's uncertainty in one way",
            )
        if self.reference_uncertainty_percent is not None and self.reference_uncertainty_of is None:
            raise ConflictError(
                "reference_uncertainty_of",
                "none, beside a percentage",
                "torque or range",
                "look into the standard's certificate which one it states",
            )
        return self

    def uncertainty(self, points: CalibrationData) -> CertifiedUncertainty:
        """Return U (k = 2) of the standard over torque, from the request or the table."""
        if self.reference_points is not None:
            return self.reference_points.certified()
        if self.reference_uncertainty_percent is None:
            if points.reference is None:
                raise InputError(
                    "reference_uncertainty_percent: none, and none in the table",
                    "a percentage, the table of the standard's certificate, or a comment "
                    "reference_uncertainty in the table",
                    "state the standard's uncertainty",
                )
            return points.reference.certified
        share = 1e-2 * self.reference_uncertainty_percent
        if self.reference_uncertainty_of == "range":
            return CertifiedUncertainty.of_range(share, points.range_nm)
        return CertifiedUncertainty.of_torque(share)


class EnterTableRequest(TableRequest):
    """A calibration of another bench, with the data that its certificate needs."""

    called: Needed = Field(default="table.csv", description="Name of the table in the records.")
    transducer_serial: Needed
    indicator: Needed = Field(
        description=("Counter or amplifier with which the transducer was read.")
    )
    measured_by: Needed = Field(description="A person of the laboratory; see `GET /people`.")
    reference_serial: Needed
    manufacturer: Words = ""
    transducer_model: Words = ""
    place: Words = ""
    reference_model: Words = ""
    reference_certificate: Words = ""
    reference_laboratory: Words = ""


@dataclass(frozen=True)
class TableDirection:
    """Result in one direction, without compensation.

    Parameters
    ----------
    name : str
        "clockwise" or "counter-clockwise".
    accuracy_class : float or None
        Class over the whole range; None if no class is met.
    remark : str
        Why there is no class.
    torque_nm : tuple of float
        Torque of the steps, N·m.
    uncertainty_percent : tuple of float
        Expanded relative uncertainty W of each step, %.
    """

    name: str
    accuracy_class: float | None
    remark: str
    torque_nm: tuple[float, ...]
    uncertainty_percent: tuple[float, ...]


@dataclass(frozen=True)
class TableView:
    """Result of reading and evaluating a table without storing it.

    Parameters
    ----------
    points : int
    range_nm : float
    simulated : bool
        Whether the table states that its points are simulated.
    profile : str
    standard_nm, error_nm : tuple of float
        Torque and error of every point, in measuring order; the error is reading minus standard,
        after subtraction of the series' zero.
    series, branch : tuple of int
    raw : ErrorSummary
        Errors of the readings against the standard.
    deviations : tuple of Deviation
        The first two hundred deviations from the profile.
    certifiable : bool
        Whether the profile allows a certificate.
    directions : tuple of TableDirection
        Evaluation of each direction by the table's steps; empty without steps.
    remarks : tuple of str
        Remarks on subtracted zeros and omitted points.
    """

    points: int
    range_nm: float
    simulated: bool
    profile: str
    standard_nm: tuple[float, ...]
    error_nm: tuple[float, ...]
    series: tuple[int, ...]
    branch: tuple[int, ...]
    raw: ErrorSummary
    deviations: tuple[Deviation, ...]
    certifiable: bool
    directions: tuple[TableDirection, ...]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class EnteredTable:
    """The registered calibration of a table, and its sealed run with the original file."""

    calibration_id: int
    run_id: str


def read_table(content: bytes, name: str = "") -> str:
    """Return the text of an uploaded file, for a `TableRequest`.

    A separate process reads the file for up to 30 s; don't call this on an event loop.

    Parameters
    ----------
    content : bytes
    name : str, optional
        File name, whose suffix determines the format; by default CSV.

    Raises
    ------
    InputError
        The file is too large, isn't a table, or expands beyond the limits.
    BusyError
        Too many other tables are being read.

    Examples
    --------
    >>> read_table("reading_nm;standard_nm".encode("utf-16"))
    'reading_nm;standard_nm'
    """
    if len(content) > LONGEST_TABLE:
        raise InputError(
            Message("an upload of {count} bytes", len(content)),
            Message("at most {limit} bytes of a table", LONGEST_TABLE),
        )
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        table = Path(scratch) / f"upload{Path(name).suffix}"
        table.write_bytes(content)
        with _reading():
            called = Path(name).name or "the upload"
            return table_text(table, called=called, isolated=True, limits=_LIMITS)


@contextmanager
def _reading() -> Iterator[None]:
    if not _READ.acquire(blocking=False):
        raise BusyError(
            Message("{count} tables are being read", MOST_READ),
            Message("{count} at a time", MOST_READ),
            "try again in a few seconds",
        )
    try:
        yield
    finally:
        _READ.release()


def states_reference(content: str) -> bool:
    """Return whether a table's comments state U of its standard."""
    return UNCERTAINTY in dict(remarks_in(content))


class TableImport:
    """Previews and registers tables.

    Parameters
    ----------
    registry : callable
        Returns the open registry.
    settings : SettingsStore
        Settings with the profiles.
    note : callable
        Called with an actor, the action, and details.
    people : callable
        Returns the names of the laboratory's people, one of whom measured.
    """

    def __init__(
        self,
        registry: Callable[[], Registry],
        settings: SettingsStore,
        note: Callable[..., None],
        people: Callable[[], Iterable[str]],
    ) -> None:
        self._registry = registry
        self._people = people
        self._settings = settings
        self._note = note

    def preview(self, request: Mapping[str, Any] | TableRequest) -> TableView:
        """Read a table and compare it with its profile, without storing it.

        A large table takes up to a second; don't call this on an event loop.

        Raises
        ------
        InputError
            A field is invalid, or a cell of the table can't be used; the message names line and
            column.
        NotFoundError
            The profile doesn't exist.
        """
        asked = _validated(TableRequest, request)
        read, profile = self._points(asked)
        points = assign_nominal(read, profile)
        deviations = _deviations(points, profile, asked)
        results = calibration_results(
            points, resolution_nm=asked.resolution_nm, reference=asked.uncertainty(points)
        )
        return TableView(
            points=len(points),
            range_nm=points.range_nm,
            simulated=points.simulated,
            profile=profile.name,
            standard_nm=tuple(points.standard_nm.tolist()),
            error_nm=tuple((-results.data.additional_torque_nm).tolist()),
            series=tuple(points.series.tolist()),
            branch=tuple(points.branch.tolist()),
            raw=results.errors_before,
            deviations=deviations[:MOST_DEVIATIONS],
            certifiable=not any(deviation.consequence == "refuse" for deviation in deviations),
            directions=tuple(_direction(each) for each in results.directions),
            remarks=results.remarks,
        )

    def enter(self, actor: Actor, request: Mapping[str, Any] | EnterTableRequest) -> EnteredTable:
        """Register a table as a calibration, to which models can be fitted like to any other.

        Raises
        ------
        PermissionDeniedError
            The actor isn't a metrologist.
        InputError, NotFoundError
            As in `preview`, or these points are registered already.
        RecordError
            The records can't be written.
        """
        require(actor, "metrologist")
        asked = _validated(EnterTableRequest, request)
        measured_by = person_among(asked.measured_by, self._people())
        asked = asked.model_copy(update={"measured_by": measured_by})
        read, profile = self._points(asked, asked.transducer_serial, asked.indicator)
        points = assign_nominal(read, profile)
        with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
            table = Path(scratch) / "table.csv"
            table.write_text(asked.content, encoding="utf-8", newline="")
            entered = register_table(
                self._registry(),
                table,
                points,
                profile,
                _circumstances(asked, points),
                operator=actor.label,
                signature=actor.signature,
                called=asked.called,
            )
        number = entered.calibration.calibration_id
        self._note(actor, "entered a table", calibration_id=number, table=asked.called)
        return EnteredTable(number, entered.run_id)

    def _points(
        self, asked: TableRequest, serial: str = "", indicator: str = ""
    ) -> tuple[CalibrationData, Profile]:
        refuse_future(asked.performed)
        _check_size(asked.content)
        profile = self._settings.profile(asked.profile)
        check_steps(profile)
        with _reading():
            read = parse_calibration(
                asked.content,
                "the table",
                range_nm=asked.range_nm,
                transducer_serial=serial,
                counter_identity=indicator,
                isolated=True,
            )
        if read.range_nm > LARGEST_NM:
            raise InputError(
                Message("a range of {range:g} N·m", read.range_nm),
                Message("at most {allowed:g} N·m", LARGEST_NM),
            )
        return read, profile


def _validated(model: type[Request], request: Mapping[str, Any] | TableRequest) -> Request:
    if isinstance(request, model):
        return request
    values = request.model_dump() if isinstance(request, BaseModel) else dict(request)
    return validated(model, values, "the table's request")


def _check_size(content: str) -> None:
    """Raise an error for a text that would take long to parse."""
    lines = content.splitlines()
    if len(lines) > MOST_LINES:
        raise InputError(
            Message("a table of {count} lines", len(lines)),
            Message("at most {limit}", MOST_LINES),
            "divide it",
        )
    longest = max(map(len, lines), default=0)
    if longest > LONGEST_LINE:
        raise InputError(
            Message("a line of {count} characters", longest),
            Message("at most {limit}", LONGEST_LINE),
        )


def _deviations(
    points: CalibrationData, profile: Profile, asked: TableRequest
) -> tuple[Deviation, ...]:
    standard = ReferenceStandard(
        getattr(asked, "reference_serial", ""),
        getattr(asked, "reference_certificate", ""),
        asked.reference_due,
    )
    return find_deviations(CalibrationRecord(points, asked.performed, standard), profile)


def _direction(direction: DirectionResults) -> TableDirection:
    side = direction.before
    return TableDirection(
        direction.name,
        None if side.classification is None else side.classification.whole_range,
        side.unclassified,
        tuple(side.evaluation.torque_nm.tolist()),
        tuple(side.expanded_percent.tolist()),
    )


def _circumstances(asked: EnterTableRequest, points: CalibrationData) -> ExternalCalibration:
    return ExternalCalibration(
        performed=asked.performed,
        measured_by=asked.measured_by,
        place=asked.place,
        transducer=Equipment(
            "transducer",
            asked.transducer_serial,
            asked.manufacturer,
            asked.transducer_model,
            points.range_nm,
        ),
        indicator=asked.indicator,
        reference=Report(
            "calibrator",
            asked.reference_serial,
            asked.reference_certificate,
            laboratory=asked.reference_laboratory,
            performed=asked.reference_performed,
            due=asked.reference_due,
        ),
        reference_model=asked.reference_model,
        resolution_nm=asked.resolution_nm,
        reference_uncertainty=(
            asked.reference_uncertainty_percent
            if asked.reference_uncertainty_percent is not None
            and asked.reference_uncertainty_of == "torque"
            else asked.uncertainty(points)
        ),
    )
