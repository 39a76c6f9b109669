"""Equipment of a laboratory by ISO/IEC 17025: what it is, its certificates, parts, adjustments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from dataclasses import field as data_field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import StringConstraints

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import Day, Number, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.readings import DayOrTime
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.records.equipment_kinds import EquipmentKind
from torquebench.reports.page import Facts, Page, Section

if TYPE_CHECKING:
    from torquebench.records import Equipment as Described
    from torquebench.records import Registry


Stated = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
Serial = Annotated[
    Stated,
    field(
        "Its serial number; of a counter its identity, of a bench its name.",
        title="Serial number",
        argument=True,
        max_length=200,
    ),
]
Reason = Annotated[str, field("Why.", max_length=500)]


@dataclass(frozen=True, kw_only=True)
class Entered(Result):
    """Entries in the registry."""

    record: str


class Equipment(Request):
    """Base of requests about one piece of equipment."""

    kind: Annotated[EquipmentKind, field("What it is.", argument=True)]
    serial: Serial

    @property
    def name(self) -> str:
        """Kind and serial number."""
        return Message("{kind} {serial}", self.kind, self.serial)


def check_known(place: Place, request: Equipment) -> Sequence[str]:
    """Raise an error for equipment that isn't entered."""
    _known(place.registry, request.kind, request.serial)
    return ()


def _known(registry: Registry, kind: EquipmentKind, serial: str) -> None:
    if not registry.equipment(kind, serial):
        raise InputError(
            Message("{value} {serial!r} isn't entered", kind, serial),
            "one of `torquebench records list equipment`",
            Message("torquebench records add-equipment {value} {serial}", kind, serial),
        )


# -- show -----------------------------------------------------------------------------------


class ShowEquipmentRequest(Request):
    """Show a piece of equipment: parts, certificates, adjustments and calibrations."""

    serial: Serial


@dataclass(frozen=True, kw_only=True)
class ShownEquipment(Result):
    """Equipment of one serial number with everything that was entered about it."""

    equipment: Sequence[Mapping[str, Any]]
    facts: Sequence[tuple[str, Sequence[tuple[str, str]]]] = data_field(metadata=HIDDEN)
    """Of each piece its name, and names and values to show."""

    def page(self) -> Page:
        """Return its description."""
        sections = [
            Section(name, "", [Facts([fact for fact in facts if fact[1]])])
            for name, facts in self.facts
        ]
        return Page(self.headline, "", sections)


def run_show(place: Place, request: ShowEquipmentRequest, _progress: Progress) -> ShownEquipment:
    """Show everything with this serial number."""
    registry, serial = place.registry, request.serial
    found = registry.equipment(serial=serial)
    if not found:
        raise InputError(
            Message("no equipment {serial!r}", serial), "one of `records list equipment`"
        )
    return ShownEquipment(
        headline=Message("Equipment {serial}", serial),
        equipment=[_everything(registry, each) for each in found],
        facts=[
            (Message("{kind} {serial}", each.kind, each.serial), _facts(registry, each))
            for each in found
        ],
    )


def _facts(registry: Registry, shown: Described) -> list[tuple[str, str]]:
    span = "" if shown.range_nm is None else f"{shown.range_nm:g} N·m"
    rows = [("type", f"{shown.manufacturer} {shown.model}".strip()), ("range", span)]
    rows += [(name, str(value)) for name, value in shown.details.items()]
    rows += [
        (part.role, Message("{part} since {day}", part.part[1], f"{part.fitted:%Y-%m-%d}"))
        for part in registry.components((shown.kind, shown.serial))
    ]
    rows += [
        (
            "certificate",
            f"{report.number}, {report.laboratory or 'laboratory not stated'}, until "
            f"{report.due or 'not stated'}, U = {report.expanded_uncertainty_percent} % of range",
        )
        for report in registry.reports(shown.serial)
        if report.kind == shown.kind
    ]
    for each in registry.adjustments(shown.serial):
        if each.kind == shown.kind:
            changed = ", ".join(
                f"{name} {each.before.get(name, '?')} to {each.after.get(name, '?')}"
                for name in dict.fromkeys([*each.before, *each.after])
            )
            words = [f"{each.what} by {each.performed_by}", changed, each.reason]
            words.append(f"checked by {each.checked_by}" if each.checked_by else "")
            text = "; ".join(word for word in words if word)
            rows.append((f"adjusted {each.performed:%Y-%m-%d}", text))
    if shown.kind == "transducer":
        rows += [
            (
                f"calibration-{each.calibration_id}",
                Message("{day}, due {due}", f"{each.performed:%Y-%m-%d}", each.due),
            )
            for each in registry.calibrations(shown.serial)
        ]
    return rows


def _everything(registry: Registry, shown: Described) -> dict[str, Any]:
    certificates, adjustments = registry.reports(shown.serial), registry.adjustments(shown.serial)
    of_kind: dict[str, Any] = {
        "parts": registry.components((shown.kind, shown.serial)),
        "certificates": [each for each in certificates if each.kind == shown.kind],
        "adjustments": [each for each in adjustments if each.kind == shown.kind],
    }
    if shown.kind == "transducer":
        of_kind["calibrations"] = registry.calibrations(shown.serial)
    return {**asdict(shown), **of_kind}


# -- enter ----------------------------------------------------------------------------------


class AddEquipmentRequest(Equipment):
    """Enter a piece of equipment, or changed data of it."""

    manufacturer: Annotated[str, field("As on its name plate.", max_length=200)] = ""
    model: Annotated[str, field("As on its name plate.", max_length=200)] = ""
    range_nm: Annotated[Number | None, field("Its full scale.", ge=1e-6, le=1e9)] = None
    details: Annotated[dict[str, str], field("Further data, as span_hz=30000.", max_length=50)] = {}  # noqa: RUF012 - pydantic copies it


def run_add_equipment(place: Place, request: AddEquipmentRequest, _progress: Progress) -> Entered:
    """Register the equipment."""
    from torquebench.records import Equipment as Described

    place.registry.add_equipment(Described(**dict(request)))
    return Entered(headline=Message("{record} entered.", request.name), record=request.name)


class AddCertificateRequest(Equipment):
    """Enter the certificate of a standard, which makes its measurements traceable."""

    basic = ("kind", "serial", "number", "uncertainty_percent", "due", "laboratory")

    number: Annotated[
        str, field("Number of its certificate.", argument=True, min_length=1, max_length=200)
    ]
    uncertainty_percent: Annotated[
        Number, field("Expanded uncertainty (k = 2), % of its range.", ge=0, le=10)
    ]
    due: Annotated[Day, field("Last day of the certificate's validity.")]
    laboratory: Annotated[
        str, field("Laboratory that has calibrated the standard.", max_length=200)
    ] = ""
    performed: Annotated[Day | None, field("Day of the standard's calibration.")] = None
    file: Annotated[Path | None, field("The certificate's file; its hash is kept.", local=True)] = (
        None
    )


def run_add_certificate(
    place: Place, request: AddCertificateRequest, _progress: Progress
) -> Entered:
    """Register the certificate."""
    from torquebench.records import Report
    from torquebench.validation import past_moment

    if request.performed is not None:
        past_moment(request.performed)
    place.registry.add_report(
        Report(
            request.kind,
            request.serial,
            request.number,
            laboratory=request.laboratory,
            performed=request.performed,
            due=request.due,
            expanded_uncertainty_percent=request.uncertainty_percent,
            file=request.file,
        )
    )
    return Entered(
        headline=Message(
            "Certificate {number} of {kind} {serial}, until {due}.",
            request.number,
            request.kind,
            request.serial,
            request.due,
        ),
        record=f"certificate {request.number}",
    )


class FitPartRequest(Equipment):
    """Enter that a part is fitted into a bench, in place of the previous part."""

    into_kind: Annotated[
        EquipmentKind,
        field("Kind of the equipment that contains the part.", argument=True),
    ]
    into_serial: Annotated[
        str,
        field(
            "Serial number or name of the equipment that contains the part.",
            argument=True,
            max_length=200,
        ),
    ]
    role: Annotated[
        str,
        field(
            "Role of the part in this equipment, such as output.transducer.",
            min_length=1,
            max_length=200,
        ),
    ]
    reason: Reason = ""


def check_part(place: Place, request: FitPartRequest) -> Sequence[str]:
    """Raise an error for a part or a whole that isn't entered."""
    _known(place.registry, request.into_kind, request.into_serial)
    return check_known(place, request)


def run_fit_part(place: Place, request: FitPartRequest, _progress: Progress) -> Entered:
    """Register that the part is fitted."""
    place.registry.fit_component(
        (request.into_kind, request.into_serial),
        (request.kind, request.serial),
        request.role,
        performed_by=place.operator,
        reason=request.reason,
        signature=place.signature,
    )
    return Entered(
        headline=Message(
            "{serial} is {role} of {into}.", request.serial, request.role, request.into_serial
        ),
        record=request.name,
    )


class AdjustRequest(Equipment):
    """Enter an adjustment: a change that may affect the indication of a piece of equipment.

    Earlier calibrations aren't valid after an adjustment.
    """

    basic = ("kind", "serial", "what", "reason", "checked_by", "performed")

    what: Annotated[
        Stated,
        field(
            "What was done, such as “span set” or “repaired”.",
            argument=True,
            max_length=500,
        ),
    ]
    reason: Reason = ""
    before: Annotated[
        dict[str, str], field("Values as found before the adjustment.", max_length=50)
    ] = {}  # noqa: RUF012 - pydantic copies it
    after: Annotated[dict[str, str], field("Values as it was left.", max_length=50)] = {}  # noqa: RUF012 - pydantic copies it
    checked_by: Annotated[str, field("Person who reviewed it.", max_length=200)] = ""
    performed: Annotated[
        DayOrTime | None,
        field("Day, or local time as 2026-01-31T14:05; now by default."),
    ] = None


def run_adjust(place: Place, request: AdjustRequest, _progress: Progress) -> Entered:
    """Register the adjustment; name a calibration that was made before it."""
    from torquebench.records import Adjustment
    from torquebench.validation import past_moment

    registry = place.registry
    moment = past_moment(request.performed or datetime.now().astimezone())
    registry.add_adjustment(
        Adjustment(
            kind=request.kind,
            serial=request.serial,
            what=request.what,
            performed=moment,
            performed_by=place.operator,
            checked_by=request.checked_by,
            reason=request.reason,
            before=request.before,
            after=request.after,
        ),
        place.signature,
    )
    newest = registry.calibrations(request.serial, limit=1) if request.kind == "transducer" else []
    record = Message("adjustment of {item}", request.name)
    return Entered(
        headline=Message("{record} entered: {what}", record, request.what),
        remarks=tuple(
            Message(
                "calibration-{number} was made before it: calibrate again", entry.calibration_id
            )
            for entry in newest
            if entry.performed <= moment
        ),
        record=record,
    )


# -- operations -----------------------------------------------------------------------------


def _entering(
    name: str, request: type[Equipment], run: Any, check: Any = check_known, *, begins: bool = False
) -> Operation:
    """Return an operation with which a metrologist enters something about equipment."""
    return Operation(
        f"records {name}",
        request,
        run,
        lambda request: Message("Enter {name}", request.name),
        check=check,
        role="metrologist",
        quick=True,
        begins=begins,
    )


EQUIPMENT = Operation(
    "records equipment",
    ShowEquipmentRequest,
    run_show,
    lambda request: Message("Equipment {serial}", request.serial),
    quick=True,
)
ADD_EQUIPMENT = _entering(
    "add-equipment", AddEquipmentRequest, run_add_equipment, lambda *_: (), begins=True
)
ADD_CERTIFICATE = _entering("add-certificate", AddCertificateRequest, run_add_certificate)
FIT_PART = _entering("fit-part", FitPartRequest, run_fit_part, check_part)
ADJUST = _entering("adjust", AdjustRequest, run_adjust)
