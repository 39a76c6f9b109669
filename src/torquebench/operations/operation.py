"""An operation: a request, and the function that performs it. All interfaces derive from it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from datetime import date, datetime
from inspect import cleandoc
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeAlias,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Gt, Le, Lt
from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    WithJsonSchema,
)
from pydantic.fields import FieldInfo

from torquebench.bench.mounting_record import MountingRecord
from torquebench.bench.roles import SIDES, Side
from torquebench.compensation.kinds import MODEL_NAMES, MODELS, NETWORKS
from torquebench.message import Message
from torquebench.operations.place import Place, Role
from torquebench.units import name_without_unit, title_of_name, unit_of_name

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.operations.preview import Preview
    from torquebench.operations.result import Result
    from torquebench.progress import Progress
    from torquebench.records import Registry


# -- types of fields ------------------------------------------------------------------------


def _whole(value: Any) -> Any:
    """Accept 20.0 for 20, which are equal in JSON, but neither text nor booleans."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("a whole number")  # noqa: TRY004 - pydantic passes TypeErrors on
    return value


def _written_time(moment: Any) -> Any:
    """Refuse times in seconds since 1970, which are probably typing mistakes."""
    if not re.match(r"\d{4}-\d{2}-\d{2}[T ]", str(moment)):
        raise ValueError("a time such as 2026-01-31T12:00:00Z")
    return moment


def _written_day(day: Any) -> Any:
    """Refuse days in seconds since 1970."""
    if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", str(day)):
        raise ValueError("a day such as 2026-01-31")
    return day


def _of_our_time(moment: datetime) -> datetime:
    """Refuse years for which databases can't convert time zones."""
    if not 1900 <= moment.year <= 2900:
        raise ValueError("a moment between 1900 and 2900")
    return moment


def _known_model(name: str) -> str:
    if name not in MODEL_NAMES:
        raise ValueError(
            "one of " + ", ".join((*MODELS, *NETWORKS, "polynomial-1 to polynomial-30"))
        )
    return name


Flag: TypeAlias = Annotated[bool, Strict()]
Number: TypeAlias = Annotated[float, Strict()]
WHOLE = BeforeValidator(_whole)
"""Validator of whole numbers; it must be the last one, or constraints are missing in the schema."""
Identifier: TypeAlias = Annotated[int, Field(ge=1, le=2**53), WHOLE]
"""Number of a record."""


@dataclass(frozen=True)
class Numbered:
    """Marks a field with a record's number, which people may write as "model-14"."""

    record: str

    def number(self, value: Any) -> Any:
        """Return the number in a record's name; leave other values to the next validator."""
        if isinstance(value, str) and value.startswith(f"{self.record}-"):
            digits = value.removeprefix(f"{self.record}-")
            value = int(digits) if digits.isdecimal() else value
        if isinstance(value, str | bytes | bool):
            raise ValueError(Message("{record} such as {record}-14", self.record))  # noqa: TRY004
        return value


def _numbered(record: str) -> Any:
    mark = Numbered(record)
    return Annotated[int, Field(ge=1, le=2**53), BeforeValidator(mark.number), mark]


ModelNumber: TypeAlias = _numbered("model")  # type: ignore[valid-type]  # as it is made above
CalibrationNumber: TypeAlias = _numbered("calibration")  # type: ignore[valid-type]
Calibration: TypeAlias = Annotated[
    str,
    BeforeValidator(lambda name: f"calibration-{name}" if type(name) is int else name),
    Field(
        description="A calibration such as calibration-3, its run or its beginning, or latest.",
        min_length=1,
        max_length=100,
        examples=["calibration-3"],
        json_schema_extra={"argument": True},
    ),
]
"""Name of a registered calibration, or its number."""
Moment: TypeAlias = Annotated[
    AwareDatetime, BeforeValidator(_written_time), AfterValidator(_of_our_time)
]
"""Time with its time zone, as text."""
Day: TypeAlias = Annotated[date, BeforeValidator(_written_day)]
"""Day as text."""
Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=500)]
"""Name of a profile or a reducer; the place determines which exist."""
ModelName: TypeAlias = Annotated[
    str,
    Field(max_length=64),
    AfterValidator(_known_model),
    WithJsonSchema({"type": "string", "enum": list(MODEL_NAMES)}),
]
"""Kind of a model."""


def _typed(values: Any) -> Any:
    """Convert texts in a mapping to None, booleans and numbers where they have this form."""
    return {n: _value(v) for n, v in values.items()} if isinstance(values, Mapping) else values


def _value(text: Any) -> Any:
    if not isinstance(text, str):
        return text
    words = {"": None, "none": None, "true": True, "false": False}
    if text.lower() in words:
        return words[text.lower()]
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


Values: TypeAlias = Annotated[dict[str, Any], BeforeValidator(_typed)]
"""Values by name, which people may write as text."""
RunId: TypeAlias = Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
"""Identifier of a run, which can't be a path."""


def plain_text(text: str, longest: int) -> str:
    r"""Return a text of one line without control characters.

    Examples
    --------
    >>> plain_text("smoke\x1b[2J\nand fire", 200)
    'smoke [2J and fire'
    """
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:longest]


def field(
    help: str,  # noqa: A002 - the word that every interface shows it under
    *,
    title: str = "",
    unit: str = "",
    argument: bool = False,
    choices: str = "",
    titles: Mapping[str, str] | None = None,
    role: Role = "operator",
    decision: bool = False,
    local: bool = False,
    output: tuple[str, ...] = (),
    file: bool = False,
    examples: tuple[Any, ...] = (),
    **limits: Any,
) -> Any:
    """Describe a field of a request.

    Parameters
    ----------
    help : str
        A sentence for the option's help and the form's field.
    title : str
        Label of the form's field; by default the field's name without its unit.
    unit : str
        Unit; by default that at the end of the field's name.
    argument : bool
        Whether the command takes the value as an argument instead of an option.
    choices : str
        Allowed names: "models", or those of the place: "profiles", "reducers" or a part of them,
        such as "profiles:random".
    titles : mapping of str to str, optional
        Titles of the choices in forms.
    role : str
        Role needed to change the default.
    decision : bool
        Whether only a person may change the default, not a program.
    local : bool
        Whether only the command has the field: a file on this computer, or a typed name.
    output : tuple of str
        Suffixes of an output file, "table" for those of all written tables, or "folder".
    file : bool
        Whether a text may also be the path of a file.
    examples : tuple
    **limits
        Limits of `pydantic.Field`, such as `ge` and `max_length`.
    """
    extra: Any = {"title": title, "unit": unit, "argument": argument}
    extra |= {"choices": choices, "role": role, "decision": decision, "local": local}
    extra["output"], extra["file"] = list(output), file
    extra["titles"] = dict(titles or {})
    return Field(
        description=help, examples=list(examples) or None, json_schema_extra=extra, **limits
    )


class Request(BaseModel):
    """Parameters of an operation.

    Attributes
    ----------
    basic : tuple of str
        Fields that a form shows unfolded, by default all but records.
    """

    basic: ClassVar[tuple[str, ...]] = ()

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __pydantic_init_subclass__(cls, **_options: Any) -> None:
        """Add the unit at the end of a field's name to the field's schema."""
        for name, info in cls.model_fields.items():
            if isinstance(info.json_schema_extra, dict):
                info.json_schema_extra["unit"] = info.json_schema_extra.get("unit") or unit_of_name(
                    name
                )


class MountedRequest(Request):
    """Base of requests that load a mounted part."""

    mounting: Annotated[
        MountingRecord,
        field(
            "Data of the mounting for the record, the report and the certificate.",
            title="Mounting",
        ),
    ] = MountingRecord()


Tolerance = Annotated[
    Number,
    field(
        "Largest error allowed, % of full scale.", title="Tolerance", gt=0, le=100, examples=(0.1,)
    ),
]
"""A tolerance in % of full scale."""


def chosen_sides(side: Literal["input", "output", "both"]) -> tuple[Side, ...]:
    """Return the chosen sides, input first."""
    return SIDES if side == "both" else (side,)


# -- a field as interfaces show it ----------------------------------------------------------


LARGEST_STATED = 1e5
LEAST_STATED = 1e-4
"""Limits beyond these only guard against nonsense: "above 0" is stated in place of a lower one."""


@dataclass(frozen=True)
class Parameter:
    """A field of a request, described for commands, forms and pages.

    Parameters
    ----------
    name, title, help, unit : str
    kind : {"number", "whole", "flag", "choice", "path", "day", "text", "record", "values"}
        "record" is a nested model with fields; "values" are names with values.
    default : object
        Default value; None without one.
    required, several, pair, optional : bool
        `several`: any number of values; `pair`: two; `optional`: null is allowed.
    choices : tuple of str
    low, high : float or None
        Limits of a number; with `above`, the lower limit itself isn't allowed.
    argument : bool
    expert : bool
        Whether forms fold it.
    names, titles, role, decision, local, output, file
        See `field`.
    record : type of BaseModel or None
    numbered : str
        Kind of record, such as "model", if the field is a record's number.
    """

    name: str
    title: str
    help: str
    unit: str
    kind: Literal["number", "whole", "flag", "choice", "path", "day", "text", "record", "values"]
    default: Any
    required: bool
    several: bool = False
    pair: bool = False
    optional: bool = False
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    above: bool = False
    argument: bool = False
    expert: bool = False
    names: str = ""
    titles: Mapping[str, str] = dataclass_field(default_factory=dict)
    record: type[BaseModel] | None = None
    numbered: str = ""
    role: Role = "operator"
    decision: bool = False
    local: bool = False
    output: tuple[str, ...] = ()
    file: bool = False

    @property
    def option(self) -> str:
        """Name of the command's option, for one value: without the unit, which the help states.

        Examples
        --------
        >>> parameters(MountedRequest)[0].option
        '--mounting'
        """
        name = name_without_unit(self.name).replace("_", "-")
        each = self.several or self.kind in ("record", "values")
        return "--" + (name.removesuffix("s") if each else name)

    @property
    def limits(self) -> str:
        """The limits as text; empty without limits."""
        if self.numbered or (self.low is None and self.high is None):
            return ""
        above, low = self.above, "" if self.low is None else f"{self.low:g}"
        if self.low is not None and 0.0 < self.low < LEAST_STATED:
            above, low = True, "0"
        if self.high is None or self.high > LARGEST_STATED:
            return f"{'>' if above else '≥'} {low}"
        if self.low is None:
            return f"≤ {self.high:g}"
        return Message("{low} to {high:g}", f"{'> ' if above else ''}{low}", self.high)


def parameters(model: type[BaseModel]) -> tuple[Parameter, ...]:
    """Return the fields of a request: arguments first, then own ones, those of bases last."""
    own = [name for name in model.model_fields if name in model.__annotations__]
    names = dict.fromkeys([*own, *model.model_fields])
    fields = [_parameter(name, model.model_fields[name]) for name in names]
    if basic := getattr(model, "basic", ()):
        fields = [
            replace(each, expert=not each.required and each.name not in basic) for each in fields
        ]
    order = list(model.model_fields)
    return tuple(sorted(fields, key=lambda each: order.index(each.name) if each.argument else 999))


def _parameter(name: str, info: FieldInfo) -> Parameter:
    kind, details, optional = _reduced(info.annotation)
    details = [*info.metadata, *details]
    pair = get_origin(kind) is tuple and get_args(kind)[-1] is not Ellipsis
    several = get_origin(kind) in (tuple, list) and not pair
    if several or pair:
        kind, inside, _ = _reduced(get_args(kind)[0])
        details += inside
    extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
    choices = tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()
    bounds = {type(each): each for each in details if isinstance(each, Gt | Ge | Le | Lt)}
    low, high = bounds.get(Ge, bounds.get(Gt)), bounds.get(Le, bounds.get(Lt))
    default = None if info.is_required() else info.get_default(call_default_factory=True)
    record = kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None
    return Parameter(
        name=name,
        title=str(extra.get("title") or info.title or title_of_name(name)),
        help=(info.description or "") if extra else "",
        unit=str(extra.get("unit") or "" if extra else info.description or "")
        or unit_of_name(name),
        kind=_kind(kind),
        default=default,
        required=info.is_required(),
        several=several,
        pair=pair,
        optional=optional,
        choices=choices,
        low=_bound(low),
        high=_bound(high),
        above=Gt in bounds and Ge not in bounds,
        argument=bool(extra.get("argument")),
        names=str(extra.get("choices") or ""),
        titles=extra.get("titles") or {},  # type: ignore[arg-type]  # as `field` has it
        role=extra.get("role") or "operator",  # type: ignore[arg-type]  # as `field` has it
        decision=bool(extra.get("decision")),
        local=bool(extra.get("local")),
        output=tuple(extra.get("output") or ()),  # type: ignore[arg-type]  # as `field` has it
        file=bool(extra.get("file")),
        record=record,
        expert=record is not None,
        numbered=next((each.record for each in details if isinstance(each, Numbered)), ""),
    )


def _bound(bound: Any) -> float | None:
    """Return the value of a limit."""
    values = (getattr(bound, name, None) for name in ("ge", "gt", "le", "lt"))
    return next((float(value) for value in values if value is not None), None)


def _kind(kind: Any) -> Any:
    if get_origin(kind) is Literal:
        return "choice"
    if get_origin(kind) in (dict, Mapping):
        return "values"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "record"
    kinds = {bool: "flag", int: "whole", float: "number", Path: "path", date: "day"}
    return kinds.get(kind, "text")


def _reduced(annotation: Any) -> tuple[Any, list[Any], bool]:
    """Return a type without annotations and None, its annotations, and whether None is allowed."""
    details: list[Any] = []
    optional = False
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation, *more = get_args(annotation)
            for each in more:
                details += each.metadata if isinstance(each, FieldInfo) else [each]
        elif origin in (Union, UnionType) and type(None) in get_args(annotation):
            optional = True
            (annotation,) = (part for part in get_args(annotation) if part is not type(None))
        else:
            return annotation, details, optional


# -- the operation --------------------------------------------------------------------------


def _nothing_to_check(_place: Place, _request: Any) -> Iterable[str]:
    """Accept every request without doubts."""
    return ()


@dataclass(frozen=True)
class Operation:
    """An operation that a person or a program can request.

    Parameters
    ----------
    name : str
        Name of the command, the API's route and the job; a command in a group includes the group's
        name: "records review".
    request : type of Request
        Its docstring describes the operation: the first line in lists, the whole docstring on its
        page.
    run : callable
        ``run(place, request, progress)`` returns a `Result`.
    title : callable
        Returns a short title of a request.
    preview : callable, optional
        ``preview(place, request)`` rehearses the operation without moving anything.
    check : callable
        ``check(place, request)`` raises an error for an impossible request before it starts, and
        returns doubts about the result as texts.
    bench : callable, optional
        ``bench(registry, request)`` returns the description of the bench that the request needs, if
        it isn't the default one.
    where : {"bench", "records", "folder", "files"}
        Whether it needs an open bench, a registry, a data directory whose registry may be lost, or
        only files.
    role : {"operator", "metrologist", "administrator"}
        Role that may request it.
    moves : bool
        Whether the bench moves, which requires that no alarm is latched.
    loads : bool
        Whether it applies torque or speed; on a real bench a person then has to confirm that the
        bench is clear.
    quick : bool
        Whether it is performed at once, not as a job.
    signed : bool
        Whether a person has to sign with the password.
    local : bool
        Whether only the command line offers it: it replaces or copies the records on which a panel
        works, or reads a queue from a file, for which the panel has its own queue.
    exclusive : bool
        Whether it needs exclusive access to the bench and its records.
    commands : bool
        Whether the panel's user needs the command of the bench; always true for movements.
    activates : bool
        Whether it may change the active models.
    beside : bool
        Whether it only listens to the bench: it runs beside jobs and without the command.
    can_pause, can_finish : bool
        Whether it can be paused, and whether a person can finish it early.
    begins : bool
        Whether the command makes a registry where none exists.
    trial : str
        Operation that shows what this one would enter; it takes the same fields.
    asks : bool
        Whether the command asks a person at a terminal for basic values that it isn't given.
    """

    name: str
    request: type[Request]
    run: Callable[[Any, Any, Progress], Result]
    title: Callable[[Any], str]
    preview: Callable[[Any, Any], Preview] | None = None
    check: Callable[[Any, Any], Iterable[str]] = _nothing_to_check
    bench: Callable[[Registry, Any], BenchDescription] | None = None
    where: Literal["bench", "records", "folder", "files"] = "records"
    role: Role = "operator"
    moves: bool = False
    loads: bool = False
    quick: bool = False
    signed: bool = False
    local: bool = False
    exclusive: bool = False
    commands: bool = False
    activates: bool = False
    beside: bool = False
    can_pause: bool = False
    can_finish: bool = False
    begins: bool = False
    trial: str = ""
    asks: bool = False

    def doubts(self, place: Place, request: Any) -> tuple[str, ...]:
        """Raise an error for an impossible request, or return doubts about the result."""
        doubts = tuple(self.check(place, request))
        mounting = getattr(request, "mounting", None)
        return doubts if mounting is None or not mounting.doubt else (*doubts, mounting.doubt)

    @property
    def key(self) -> str:
        """Name in URLs and in Python."""
        return self.name.replace(" ", "-")

    @property
    def served(self) -> bool:
        """Whether panel and API offer it."""
        return not self.local

    @property
    def local_fields(self) -> tuple[str, ...]:
        """Names of the fields that only the command has."""
        return tuple(each.name for each in parameters(self.request) if each.local)

    @property
    def signable(self) -> bool:
        """Whether a person can sign it with the password; true for decisions performed at once."""
        return self.signed or (self.quick and self.role != "operator")

    @property
    def summary(self) -> str:
        """First line of its description."""
        return self.description.partition("\n")[0]

    @property
    def description(self) -> str:
        """Docstring of the request, without indentation."""
        return cleandoc(self.request.__doc__ or "")

    @property
    def paragraphs(self) -> tuple[str | tuple[str, ...], ...]:
        """The description's paragraphs, each on one line; a list is a tuple of its items."""
        return tuple(
            tuple(" ".join(item.split()) for item in part.removeprefix("- ").split("\n- "))
            if part.startswith("- ")
            else " ".join(part.split())
            for part in self.description.split("\n\n")
        )

    @property
    def result(self) -> type[Result]:
        """Type of its result."""
        return get_type_hints(self.run)["return"]  # type: ignore[no-any-return]


def on_files(
    name: str,
    request: type[Request],
    run: Callable[[Any, Any, Progress], Result],
    title: Callable[[Any], str],
    check: Callable[[Any, Any], Iterable[str]] = _nothing_to_check,
    *,
    quick: bool = True,
) -> Operation:
    """Return an operation that only reads and writes files."""
    return Operation(name, request, run, title, check=check, where="files", quick=quick)
