"""Tables of the registry as mapped dataclasses: a class is a table, an instance is a row.

Every table is append-only: triggers refuse changes, and the chain's links reveal changes that
bypass them. Later information (a run's end, the state of equipment, a calibration's review) is
added as a separate row that refers to the original.

A field with a label is displayed wherever the entry is displayed; see `facts`. A new column needs a
migration that adds it.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, make_dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from types import MappingProxyType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
    get_args,
    get_origin,
)

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    ColumnElement,
    Date,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    func,
    inspect,
    select,
)
from sqlalchemy.orm import (
    DeclarativeBase,
    Mapped,
    MappedAsDataclass,
    aliased,
    column_property,
    composite,
    mapped_column,
)

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.equipment_kinds import EquipmentKind
from torquebench.records.files import json_text, revived, sha256_of_file, with_messages
from torquebench.records.signatures import Signature

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData, Contradiction


class UtcDateTime(TypeDecorator[datetime]):
    """A time with time zone, stored in UTC, because SQLite stores no time zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Convert a time to UTC before it is stored."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Add the time zone to a stored time."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Document(TypeDecorator[Any]):
    """Plain JSON that keeps the templates of its messages; see `with_messages`."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: Any, _dialect: Dialect) -> Any:
        """Convert a value to plain JSON."""
        return None if value is None else json.loads(json_text(with_messages(value)))

    def coerce_compared_value(self, op: Any, value: Any) -> Any:
        """Compare parts of the document as SQLAlchemy compares JSON."""
        return self.impl_instance.coerce_compared_value(op, value)


Entry = TypeVar("Entry", bound="Registered")
Sha256 = Annotated[str, 64]
Json = Mapping[str, Any]
Files = Mapping[str, str]
HIDDEN: Json = MappingProxyType({"exclude": True})
"""Metadata of a field that the panel's API doesn't return: numbers of rows, paths."""

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class Registered(MappedAsDataclass, DeclarativeBase):
    """Base class of all kinds of entries.

    A field declared by `_through` is stored in another table's row, to which a key of this row
    refers. Reading takes its value from there; adding an entry stores the key of the row with that
    value.
    """

    metadata = metadata
    type_annotation_map = MappingProxyType(
        {
            str: Text,
            Sha256: String(64),
            int: Integer,
            float: Double,
            bool: Boolean,
            datetime: UtcDateTime,
            date: Date,
            Path: Text,
            Json: Document,
            Files: Document,
            Signature: Document(none_as_null=True),
        }
    )

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for each in fields(cls):
            if get_origin(each.type) is Mapped:  # dataclass tools need the type without `Mapped`
                each.type = get_args(each.type)[0]
            if "through" in each.metadata:
                key, attribute = each.metadata["through"]
                value = _value_at(cls.__table__.c[key], *attribute.split("."))
                _derive(cls, each.name, func.coalesce(value, "") if each.default == "" else value)

    @classmethod
    def __get_pydantic_core_schema__(cls, _source: object, handler: Any) -> Any:
        """Return the schema for the panel's API: a plain dataclass with the entry's fields."""
        from pydantic_core import core_schema

        plain = make_dataclass(
            cls.__name__,
            [
                (each.name, each.type, field(metadata=each.metadata))
                for each in fields(cls)
                if not each.metadata.get("exclude")
            ],
            kw_only=True,
        )
        plain.__doc__ = (cls.__doc__ or "").partition("\n\n")[0]
        return core_schema.no_info_before_validator_function(
            lambda value: asdict(value) if isinstance(value, cls) else value,
            handler.generate_schema(plain),
        )


def _derive(kind: type[Registered], name: str, value: Any) -> None:
    """Define a field of a kind of entry that is read from other rows."""
    if name in vars(kind):  # the default of its dataclass
        type.__delattr__(kind, name)
    setattr(kind, name, column_property(value))


def _value_at(key: ColumnElement[Any], kind: str, attribute: str) -> Any:
    """Return the query for an attribute of the row to which a key refers."""
    (target,) = (each for each in Registered.__subclasses__() if each.__name__ == kind)
    row = aliased(target)
    number = inspect(target).get_property_by_column(target.__table__.c.id).key
    return select(getattr(row, attribute)).where(getattr(row, number) == key).scalar_subquery()


def _number() -> Any:
    """Declare the primary key column."""
    return mapped_column("id", Integer, primary_key=True)


def _key(table: str, *, nullable: bool = False, index: bool = False) -> Any:
    """Declare a foreign key column to another table; see `_through`."""
    return mapped_column(ForeignKey(f"{table}.id"), nullable=nullable, index=index or None)


def _recorded() -> Any:
    """Declare the column with the time of entry."""
    return mapped_column(UtcDateTime, nullable=False)


def _through(key: str, attribute: str, label: str = "", **options: Any) -> Any:
    """Declare a field that is stored in the row to which a key of this class refers."""
    more = {"label": label} if label else {}
    kind = {"kind": options.pop("kind")} if "kind" in options else {}
    return field(metadata={"through": (key, attribute), **kind, **more}, **options)


def _serial(key: str, kind: EquipmentKind, label: str = "", **default: Any) -> Any:
    """Declare the serial number of a piece of equipment of a kind."""
    return _through(key, "Identity.serial", label, kind=kind, **default)


def _stated(label: str, **options: Any) -> Any:
    """Declare a column that is displayed with its label wherever the entry is displayed."""
    return mapped_column(dataclass_metadata={"label": label}, **options)


def _of_calibration(attribute: str) -> Any:
    """Declare a field of a model that is read from its calibration."""
    return _through("calibration_key", attribute, init=False)


# -- runs ---------------------------------------------------------------------------------------


class RunEnd(Registered, kw_only=True):
    """How a run ended, and the hash of the manifest that seals its folder."""

    __tablename__ = "run_ends"

    number = _number()
    run_key: Mapped[int] = mapped_column(ForeignKey("runs.id"), unique=True)
    finished: Mapped[datetime]
    status: Mapped[str]
    reason: Mapped[str]
    manifest_sha256: Mapped[Sha256]


class RunSummary(Registered, kw_only=True):
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
    doubts : tuple of str
        Implausible times; filled in by the lists that check for them.
    """

    __tablename__ = "runs"
    # These indexes, read backwards, serve lists of runs sorted newest first.
    __table_args__ = (
        Index("ix_runs_started", "started", "id"),
        Index("ix_runs_kind_started", "kind", "started", "id"),
    )

    number = _number()
    run_id: Mapped[str] = mapped_column(unique=True)
    kind: Mapped[str]
    started: Mapped[datetime]
    side: Mapped[str] = mapped_column(default="")
    operator: Mapped[str] = mapped_column(default="")
    bench: Mapped[str] = mapped_column(default="")
    simulated: Mapped[bool]
    profile_name: Mapped[str] = mapped_column(
        default="", dataclass_metadata={"serialization_alias": "profile"}
    )
    profile_sha256: Mapped[Sha256] = mapped_column(default="")
    software_version: Mapped[str]
    folder: Mapped[Path] = mapped_column(dataclass_metadata=HIDDEN)
    finished: datetime | None = None
    status: str = "running"
    reason: str = ""
    manifest_sha256: str = ""
    doubts: tuple[str, ...] = field(default=(), compare=False)


for _name in ("finished", "status", "reason", "manifest_sha256"):
    _of_end: Any = select(getattr(RunEnd, _name)).where(RunEnd.run_key == RunSummary.number)
    _of_end = _of_end.scalar_subquery()
    if _name != "finished":
        _of_end = func.coalesce(_of_end, "running" if _name == "status" else "")
    _derive(RunSummary, _name, _of_end)


class AuditEnd(Registered):
    """The end of an audit log when its bench was closed; it reveals a later removal of lines."""

    __tablename__ = "audit_ends"

    number = _number()
    log: Mapped[str]
    line: Mapped[int]
    sha256: Mapped[Sha256]
    recorded = _recorded()


# -- equipment ----------------------------------------------------------------------------------


class Identity(Registered):
    """Kind and serial number of a piece of equipment, which never change."""

    __tablename__ = "equipment"
    __table_args__ = (Index("ix_equipment_identity", "kind", "serial", unique=True),)

    number = _number()
    kind: Mapped[EquipmentKind] = mapped_column(Text)
    serial: Mapped[str]
    recorded = _recorded()


class Equipment(Registered):
    """A transducer, standard, counter, drive, encoder, bench or tested reducer.

    Its data from a certain time on; the latest row is valid.

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

    __tablename__ = "equipment_descriptions"

    number = _number()
    kind: EquipmentKind = _through("equipment_key", "Identity.kind")
    serial: str = _through("equipment_key", "Identity.serial")
    equipment_key = _key("equipment", index=True)
    manufacturer: Mapped[str] = mapped_column(default="")
    model: Mapped[str] = mapped_column(default="")
    range_nm: Mapped[float | None] = mapped_column(default=None)
    details: Mapped[Json] = mapped_column(default_factory=dict)
    recorded = _recorded()


@dataclass(frozen=True)
class Component:
    """A piece of equipment that is built into another one.

    Parameters
    ----------
    whole, part : tuple of kind and serial
        The whole, and the part fitted into it.
    role : str
        Role, such as ``"output.transducer"``.
    fitted : datetime.datetime
        When it was fitted.
    """

    whole: tuple[str, str]
    part: tuple[str, str]
    role: str
    fitted: datetime
    fitted_by: str = ""


class ComponentChange(Registered):
    """A piece of equipment was fitted into another one, or removed from it."""

    __tablename__ = "components"

    number = _number()
    whole_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    part_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    role: Mapped[str]
    change: Mapped[Literal["fitted", "removed"]] = mapped_column(Text)
    performed: Mapped[datetime]
    performed_by: Mapped[str]
    reason: Mapped[str]


class Adjustment(Registered, kw_only=True):
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

    __tablename__ = "adjustments"

    number = _number()
    kind: EquipmentKind = _through("equipment_key", "Identity.kind")
    serial: str = _through("equipment_key", "Identity.serial")
    equipment_key = _key("equipment", index=True)
    what: Mapped[str]
    before: Mapped[Json] = mapped_column(default_factory=dict)
    after: Mapped[Json] = mapped_column(default_factory=dict)
    performed: Mapped[datetime]
    performed_by: Mapped[str]
    checked_by: Mapped[str] = mapped_column(default="")
    reason: Mapped[str] = mapped_column(default="")


class TorqueRange(NamedTuple):
    """Lowest and highest torque in N·m."""

    low_nm: float
    high_nm: float

    def __composite_values__(self) -> "TorqueRange":
        return self


class Report(Registered):
    """A laboratory's calibration certificate of a standard, which gives traceability.

    Parameters
    ----------
    kind, serial : str
        The standard.
    number, laboratory : str
        Of the certificate.
    performed, due : datetime.date, optional
        Day of the calibration, and last day on which the certificate is valid.
    valid_nm : tuple of float, optional
        Lowest and highest torque that it covers, in N·m.
    expanded_uncertainty_percent : float, optional
        Largest U (k = 2) of the standard, % of its range. If U is certified as a share of the
        torque, it is largest at full range.
    file : pathlib.Path, optional
        The certificate's file, which is hashed when it is registered.
    """

    __tablename__ = "reports"

    report_id = _number()
    kind: EquipmentKind = _through("equipment_key", "Identity.kind")
    serial: str = _through("equipment_key", "Identity.serial")
    equipment_key = _key("equipment", index=True)
    number: Mapped[str]  # type: ignore[misc]  # the fields before have no default
    laboratory: Mapped[str] = mapped_column(default="")
    performed: Mapped[date | None] = mapped_column(default=None)
    due: Mapped[date | None] = mapped_column(default=None)
    measured_by: Mapped[str] = mapped_column(default="")
    checked_by: Mapped[str] = mapped_column(default="")
    valid_nm: Mapped[TorqueRange | None] = composite(
        mapped_column("valid_low_nm", Double, nullable=True),
        mapped_column("valid_high_nm", Double, nullable=True),
        default=None,
    )
    expanded_uncertainty_percent: Mapped[float | None] = mapped_column(default=None)
    file: Mapped[Path | None] = mapped_column(default=None, nullable=False)
    file_sha256: Mapped[Sha256] = mapped_column(default="")
    recorded = _recorded()


class Zeroing(Registered, kw_only=True):
    """The unloaded zero of a transducer.

    Parameters
    ----------
    zero_hz, zero_nm : float
        Frequency (or the transducer's other signal, in its unit), and its deviation from the
        nominal zero in N·m.
    """

    __tablename__ = "zeroings"
    __table_args__ = (Index("ix_zeroings_transducer", "transducer_key", "performed"),)

    number = _number()
    transducer_serial: str = _serial("transducer_key", "transducer")
    transducer_key = _key("equipment")
    run_id: str | None = _through("run_key", "RunSummary.run_id", default=None)
    run_key = _key("runs", nullable=True)
    performed: Mapped[datetime]
    zero_hz: Mapped[float]
    zero_nm: Mapped[float]
    temperature_c: Mapped[float | None] = mapped_column(default=None)
    simulated: Mapped[bool] = mapped_column(default=False)


# -- calibrations -------------------------------------------------------------------------------


class CalibrationEntry(Registered, kw_only=True):
    """One calibration of one chain.

    Parameters
    ----------
    calibration_id : int
        Its number in the registry.
    run_id : str or None
        The run that measured it; None for an external table.
    transducer_serial, counter_identity : str
        The measuring chain for which it is valid.
    standard_serial, measured_by : str
        The reference standard, and the person who measured.
    valid_nm : tuple of float
        Lowest and highest torque that it is valid for, in N·m.
    due : datetime.date or None
        When the chain is to be calibrated again.
    temperature_c : float or None
        Mean temperature of the transducer over the points, in °C; None where it wasn't measured,
        and before 0.3.0.
    files : mapping of str to str
        SHA-256 of its files, by name.
    signature : Signature or None
        How the name in `measured_by` was authenticated; None before 0.3.0.
    doubts : tuple of str
        An expired standard, implausible times; filled in by the lists that check for them.
    """

    __tablename__ = "calibrations"

    calibration_id: Mapped[int] = mapped_column("id", primary_key=True, init=False)
    run_id: str | None = _through("run_key", "RunSummary.run_id", "run", default=None)
    run_key = _key("runs", nullable=True)
    transducer_serial: str = _serial("transducer_key", "transducer", "transducer")
    transducer_key = _key("equipment", index=True)
    counter_identity: str = _serial("counter_key", "counter", "counter")
    counter_key = _key("equipment")
    standard_serial: str = _serial("standard_key", "calibrator", "standard", default="")
    standard_key = _key("equipment", nullable=True)
    performed: Mapped[datetime] = _stated("performed")
    measured_by: Mapped[str] = _stated("measured by", default="")
    range_nm: Mapped[float] = _stated("range in N·m")
    valid_nm: Mapped[TorqueRange] = composite(
        mapped_column("valid_low_nm", Double, nullable=False),
        mapped_column("valid_high_nm", Double, nullable=False),
        default=TorqueRange(0.0, 0.0),
        dataclass_metadata={"label": "valid in N·m"},
    )
    due: Mapped[date | None] = _stated("due", default=None)
    points: Mapped[int] = _stated("points")
    data_sha256: Mapped[Sha256] = _stated("data SHA-256")
    profile_name: Mapped[str] = mapped_column(
        default="", dataclass_metadata={"serialization_alias": "profile", "label": "profile"}
    )
    profile_sha256: Mapped[Sha256] = _stated("profile SHA-256", default="")
    simulated: Mapped[bool] = _stated("simulated")
    files: Mapped[Files] = mapped_column(default_factory=dict)
    summary: Mapped[Json] = mapped_column(default_factory=dict)
    signature: Mapped[Signature | None] = _stated("entered", default=None)
    temperature_c: Mapped[float | None] = _stated("mean temperature in °C", default=None)
    doubts: tuple[str, ...] = field(default=(), compare=False)

    @classmethod
    def of_points(cls, data: "CalibrationData", *, performed: datetime, **more: Any) -> Self:
        """Make the entry of a calibration from its points.

        Parameters
        ----------
        data : CalibrationData
            Points with transducer serial and counter identity.
        performed : datetime.datetime
            When it was performed, with time zone.
        **more
            Other fields. The errors of the span are added to the summary, because control charts
            need them.
        """
        from torquebench.calibration import span_errors  # not imported for lists of records

        temperature_c = None if data.temperature_c is None else float(data.temperature_c.mean())
        low, high = min(data.standard_nm.min(), 0.0), max(data.standard_nm.max(), 0.0)
        summary = {**more.pop("summary", {}), "span_error_percent": span_errors(data)}
        return cls(
            transducer_serial=data.transducer_serial,
            counter_identity=data.counter_identity,
            performed=performed,
            range_nm=data.range_nm,
            valid_nm=TorqueRange(float(low), float(high)),
            points=len(data),
            temperature_c=temperature_c,
            data_sha256=data.sha256(),
            simulated=data.simulated,
            summary=summary,
            **more,
        )


class ModelEntry(Registered, kw_only=True):
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
    transducer_serial, counter_identity, simulated
        Of its calibration.
    active : bool
        Whether the model is in use; filled in by `Registry.model` and `Registry.models`.
    """

    __tablename__ = "models"

    model_id: Mapped[int] = mapped_column("id", primary_key=True, init=False)
    calibration_id: Mapped[int] = mapped_column(
        "calibration_key", ForeignKey("calibrations.id"), index=True
    )
    kind: Mapped[str]
    file: Mapped[Path] = mapped_column(dataclass_metadata=HIDDEN)
    file_sha256: Mapped[Sha256]
    range_nm: Mapped[float]
    side: Mapped[str] = mapped_column(default="")
    metrics: Mapped[Json] = mapped_column(default_factory=dict)
    created: Mapped[datetime]
    transducer_serial: str = _of_calibration("CalibrationEntry.transducer_serial")
    counter_identity: str = _of_calibration("CalibrationEntry.counter_identity")
    simulated: bool = _of_calibration("CalibrationEntry.simulated")
    active: bool = field(default=False, compare=False)

    @property
    def contradictions(self) -> "tuple[Contradiction, ...]":
        """Contradictions in the calibration's data, which speak against activating the model."""
        if "contradictions" not in self.metrics:
            return ()
        from torquebench.calibration import Contradiction  # not imported for lists of models

        return tuple(Contradiction(**each) for each in self.metrics["contradictions"])

    def check_file(self) -> Path:
        """Return the path of the model file after checking that its content is unchanged.

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


class Activation(Registered, kw_only=True):
    """Activation of a model for a chain, or with model_id None, deactivation of its compensation.

    `signature` says how the decision was authenticated; it is None before 0.3.0.
    """

    __tablename__ = "activations"
    __table_args__ = (Index("ix_activations_chain", "transducer_key", "counter_key", "id"),)

    number = _number()
    transducer_serial: str = _serial("transducer_key", "transducer")
    transducer_key = _key("equipment")
    counter_identity: str = _serial("counter_key", "counter")
    counter_key = _key("equipment")
    model_id: Mapped[int | None] = mapped_column("model_key", ForeignKey("models.id"))
    activated: Mapped[datetime]
    operator: Mapped[str]
    reason: Mapped[str]
    signature: Mapped[Signature | None] = _stated("signature", default=None)


class VerificationEntry(Registered, kw_only=True):
    """Result of a verification for one model; its numbers are in `summary`."""

    __tablename__ = "verifications"

    number = _number()
    model_id: Mapped[int] = mapped_column("model_key", ForeignKey("models.id"), index=True)
    run_id: str | None = _through("run_key", "RunSummary.run_id", default=None)
    run_key = _key("runs", nullable=True)
    performed: Mapped[datetime]
    measured_by: Mapped[str] = mapped_column(default="")
    data_sha256: Mapped[Sha256]
    simulated: Mapped[bool]
    summary: Mapped[Json]


class CheckEntry(Registered, kw_only=True):
    """A quick check of a chain against the check standard.

    Parameters
    ----------
    verdict : str
        ``"pass"``, ``"conditionalPass"``, ``"conditionalFail"`` or ``"fail"``.
    worst_percent_fs, tolerance_percent_fs : float
        Largest error, and the tolerance, in % of full scale.
    """

    __tablename__ = "checks"
    __table_args__ = (Index("ix_checks_transducer", "transducer_key", "performed"),)

    number = _number()
    transducer_serial: str = _serial("transducer_key", "transducer")
    transducer_key = _key("equipment")
    standard_serial: str = _serial("standard_key", "verification-standard", default="")
    standard_key = _key("equipment", nullable=True)
    model_id: Mapped[int | None] = mapped_column("model_key", ForeignKey("models.id"), default=None)
    run_id: str | None = _through("run_key", "RunSummary.run_id", default=None)
    run_key = _key("runs", nullable=True)
    performed: Mapped[datetime]
    measured_by: Mapped[str] = mapped_column(default="")
    verdict: Mapped[str]
    worst_percent_fs: Mapped[float]
    tolerance_percent_fs: Mapped[float]
    simulated: Mapped[bool]
    summary: Mapped[Json] = mapped_column(default_factory=dict)


# -- certificates, reviews, amendments ----------------------------------------------------------


class CertificateEntry(Registered, kw_only=True):
    """An issued certificate, as stored, listed, exported and sent.

    Parameters
    ----------
    number : str
        Its unique number.
    authorised_by : str
        Who authorised it.
    files : mapping of str to str
        SHA-256 by file name.
    summary : mapping
        Summary of its statements; see `of_record`.
    supersedes : str
        Number of the certificate that it replaces; empty for a first one.
    signature : Signature or None
        How the authorisation was authenticated; None before 0.3.0.
    superseded_by : str
        Number of the certificate that replaces it; empty if there is none.
    """

    __tablename__ = "certificates"

    certificate_id = _number()
    number: Mapped[str] = mapped_column(unique=True)
    calibration_id: Mapped[int] = mapped_column(
        "calibration_key", ForeignKey("calibrations.id"), index=True
    )
    supersedes: str = _through("supersedes_key", "CertificateEntry.number", default="")
    supersedes_key = _key("certificates", nullable=True)
    issued: Mapped[datetime]
    authorised_by: Mapped[str]
    files: Mapped[Files]
    summary: Mapped[Json] = mapped_column(default_factory=dict)
    signature: Mapped[Signature | None] = _stated("signature", default=None)
    superseded_by: str = field(default="", compare=False)

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
        """Make the entry of a certificate from its record.

        Parameters
        ----------
        record : mapping
            The content of the certificate's JSON file.
        files : mapping of str to str
            SHA-256 by file name.
        archive : str
            Folder of its files; see `archive`.
        issued : datetime.datetime
            When it was entered, with time zone.
        calibration_id : int
            Number of its calibration in this registry.
        **more : str
            Further entries of the summary.
        """
        conformity, digest = record["conformity"] or {}, sha256_of_record(record)
        acts = record.get("acts", [])
        signature = next((each["signature"] for each in acts if each["role"] == "authorised"), None)
        summary = {
            "record_sha256": digest,
            "languages": record["languages"],
            "simulated": record["simulated"],
            "unreviewed": record.get("unreviewed", []),
            "verdict": conformity.get("verdict"),
            "tolerance_percent_fs": conformity.get("tolerance_percent_fs"),
            "archive": archive,
            "profile": record["method"]["name"],
            "profile_sha256": record["method"]["sha256"],
            "deviations": [each["clause"] for each in record["deviations"]],
            "acts": acts,
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
            signature=Signature.restored(signature).about({"record": digest})
            if signature
            else None,
        )

    @property
    def acts(self) -> tuple[tuple[str, str, Signature | None], ...]:
        """Role, name and signature of review, use and authorisation; empty before 0.3.0."""
        return tuple(
            (
                act["role"],
                act["name"],
                Signature.restored(act["signature"]) if act.get("signature") else None,
            )
            for act in self.summary.get("acts", [])
            if act["role"] != "measured"
        )

    @property
    def archive(self) -> str:
        """Folder of its files: an absolute path, or relative to the data directory."""
        return archived_at(self.number, self.summary)


def archived_at(number: str, summary: Mapping[str, Any]) -> str:
    """Return the folder in which a certificate's files were stored when it was issued.

    Examples
    --------
    >>> archived_at("TB-1", {})
    'certificates/TB-1'
    """
    return str(summary.get("archive", f"certificates/{number}"))


def sha256_of_record(record: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a certificate's record, independent of the JSON's layout."""
    text = json.dumps(record, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


class Review(Registered):
    """A review of a record, and its result.

    `signature` says how the reviewer was authenticated and what was reviewed; None before 0.3.0.
    """

    __tablename__ = "reviews"
    __table_args__ = (Index("ix_reviews_subject", "subject", "subject_key"),)

    number = _number()
    subject: Mapped[str]
    subject_id: Mapped[int] = mapped_column("subject_key")
    checked: Mapped[datetime]
    checked_by: Mapped[str]
    accepted: Mapped[bool]
    remark: Mapped[str]
    signature: Mapped[Signature | None] = _stated("signature", default=None)


class Amendment(Registered):
    """An amendment of a record; the record itself isn't changed.

    Parameters
    ----------
    subject, subject_id : str, int
        Table and number of the record that it amends.
    changes : mapping
        Field to its correct value.
    """

    __tablename__ = "amendments"
    __table_args__ = (Index("ix_amendments_subject", "subject", "subject_key"),)

    number = _number()
    subject: Mapped[str]
    subject_id: Mapped[int] = mapped_column("subject_key")
    amended: Mapped[datetime]
    amended_by: Mapped[str]
    reason: Mapped[str]
    changes: Mapped[Json]
    signature: Mapped[Signature | None] = _stated("signature", default=None)


links = Table(
    "chain",
    metadata,
    Column("sequence", Integer, primary_key=True, autoincrement=False),
    Column("table", Text, nullable=False),
    Column("key", Integer, nullable=False),
    Column("recorded", Text, nullable=False),
    Column("content", Text, nullable=False),
    Column("previous_sha256", String(64), nullable=False),
    Column("sha256", String(64), nullable=False, unique=True),
    Index("ix_chain_row", "table", "key", unique=True),
)
"""The hash chain: a link for every row of the other tables, with the row's content when entered."""


def facts(entry: Registered) -> Iterator[tuple[str, Any]]:
    """Yield label and value of every field of an entry that has a label and a value."""
    for each in fields(entry):
        value = getattr(entry, each.name)
        if "label" in each.metadata and value not in (None, ""):
            yield each.metadata["label"], value


def entry_of(kind: type[Entry], columns: Mapping[Any, Any], root: Path = Path()) -> Entry:
    """Make an entry from columns that are named like its fields.

    Parameters
    ----------
    kind : type
        Kind of entry.
    columns : mapping
        Values by field name; a field without a value gets its default.
    root : pathlib.Path
        Data directory to which stored paths are relative.
    """
    known = {
        each.name: columns[each.name]
        for each in fields(kind)
        if each.init and columns.get(each.name) is not None
    }
    if columns.get("valid_low_nm") is not None and "valid_nm" in kind.__dataclass_fields__:
        known["valid_nm"] = TorqueRange(columns["valid_low_nm"], columns["valid_high_nm"])
    entry = completed(kind(**known), root)
    for each in fields(kind):
        if not each.init:
            setattr(entry, each.name, columns.get(each.name))
    return entry


def completed(entry: Entry, root: Path = Path()) -> Entry:
    """Convert the stored columns of an entry: absolute paths, messages, signatures."""
    for each in fields(entry):
        value = getattr(entry, each.name)
        if each.type in (Path, Path | None):
            setattr(entry, each.name, root / value if value else None)
        elif each.type == Signature | None and value is not None:
            setattr(entry, each.name, Signature.restored(value))
        elif isinstance(value, dict):
            setattr(entry, each.name, revived(value))
        elif isinstance(value, bytes):
            raise ValueError(f"{each.name} is a blob")
    return entry
