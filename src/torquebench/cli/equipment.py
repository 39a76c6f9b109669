"""`torquebench records adjust`, `add-equipment`, `add-certificate`, `fit-part`, `equipment`.

Records of a laboratory about its equipment, by ISO/IEC 17025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from dataclasses import field as data_field
from datetime import date, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    DataOption,
    data_directory,
    day_or_time,
    moment_in_utc,
    named_values,
    performed_at,
)
from torquebench.cli.records.checks import Entered
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN, Result
from torquebench.reports.page import Facts, Page, Section

if TYPE_CHECKING:
    from torquebench.records import Equipment, Registry

__all__ = ["add_certificate", "add_equipment", "adjust", "equipment", "fit_part"]


class Kind(StrEnum):
    """Kinds of equipment."""

    transducer = "transducer"
    calibrator = "calibrator"
    verification_standard = "verification-standard"
    counter = "counter"
    drive = "drive"
    encoder = "encoder"
    bench = "bench"
    reducer = "reducer"


KindArgument = Annotated[Kind, typer.Argument(help="What it is.")]
SerialArgument = Annotated[
    str, typer.Argument(help="Its serial number; of a counter its identity, of a bench its name.")
]


def add_equipment(
    kind: KindArgument,
    serial: SerialArgument,
    manufacturer: Annotated[str, typer.Option(help="As on its name plate.")] = "",
    model: Annotated[str, typer.Option(help="As on its name plate.")] = "",
    range_nm: Annotated[
        float | None, typer.Option("--range", min=1e-6, help="Its full scale in N·m.")
    ] = None,
    detail: Annotated[list[str] | None, typer.Option(help="name=value; repeatable.")] = None,
    data: DataOption = DEFAULT_DATA,
) -> Entered:
    """Enter a piece of equipment, or changed data of it."""
    from torquebench.records import Equipment, Registry

    details = named_values(detail, "--detail", "span_hz=30000")
    described = Equipment(kind.value, _named(serial), manufacturer, model, range_nm, details)
    with Registry.open(data) as registry:
        registry.add_equipment(described)
    record = f"{kind.value} {serial}"
    return Entered(headline=Message("{record} entered.", record), record=record)


def add_certificate(
    kind: KindArgument,
    serial: SerialArgument,
    number: Annotated[str, typer.Argument(help="Number of its certificate.")],
    uncertainty: Annotated[
        float, typer.Option(min=0, max=10, help="Expanded uncertainty (k = 2), % of its range.")
    ],
    due: Annotated[
        datetime,
        typer.Option(
            parser=moment_in_utc, metavar="DAY", help=("Last day of the certificate's validity.")
        ),
    ],
    laboratory: Annotated[
        str, typer.Option(help="Laboratory that has calibrated the standard.")
    ] = "",
    performed: Annotated[
        date | None,
        typer.Option(parser=day_or_time, metavar="DAY", help="Day of the standard's calibration."),
    ] = None,
    file: Annotated[
        Path | None, typer.Option(help="The certificate's file; its hash is kept.")
    ] = None,
    data: DataOption = DEFAULT_DATA,
) -> Entered:
    """Enter the certificate of a standard, which makes its measurements traceable."""
    from torquebench.records import Registry, Report

    day = None
    if performed is not None:
        performed_at(performed)
        day = performed.date() if isinstance(performed, datetime) else performed
    with Registry.open(data_directory(data)) as registry:
        _known(registry, kind, serial)
        registry.add_report(
            Report(
                kind.value,
                serial,
                number,
                laboratory=laboratory,
                performed=day,
                due=due.date(),
                expanded_uncertainty_percent=uncertainty,
                file=file,
            )
        )
    return Entered(
        headline=Message(
            "Certificate {number} of {kind} {serial}, until {due:%Y-%m-%d}.",
            number,
            kind.value,
            serial,
            due,
        ),
        record=f"certificate {number}",
    )


def fit_part(
    kind: KindArgument,
    serial: SerialArgument,
    into_kind: Annotated[
        Kind, typer.Argument(help="Kind of the equipment that contains the part.")
    ],
    into_serial: Annotated[
        str, typer.Argument(help=("Serial number or name of the equipment that contains the part."))
    ],
    role: Annotated[
        str, typer.Option(help=("Role of the part in this equipment, such as output.transducer."))
    ],
    by: Annotated[str, typer.Option(help="Who has fitted it.")],
    reason: Annotated[str, typer.Option(help="Why.")] = "",
    data: DataOption = DEFAULT_DATA,
) -> Entered:
    """Enter that a part is fitted into a bench, in place of the previous part."""
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        _known(registry, kind, serial)
        _known(registry, into_kind, into_serial)
        registry.fit_component(
            (into_kind.value, into_serial),
            (kind.value, serial),
            role,
            performed_by=by,
            reason=reason,
        )
    return Entered(
        headline=Message("{serial} is {role} of {into}.", serial, role, into_serial),
        record=f"{kind.value} {serial}",
    )


def adjust(
    kind: KindArgument,
    serial: SerialArgument,
    what: Annotated[str, typer.Argument(help="What was done, such as “span set” or “repaired”.")],
    by: Annotated[str, typer.Option(help="Who has done it.")],
    reason: Annotated[str, typer.Option(help="Why.")] = "",
    before: Annotated[
        list[str] | None,
        typer.Option(help=("name=value as found before the adjustment; repeatable.")),
    ] = None,
    after: Annotated[
        list[str] | None, typer.Option(help="name=value as it was left; repeatable.")
    ] = None,
    checked_by: Annotated[str, typer.Option(help="Person who reviewed it.")] = "",
    performed: Annotated[
        date | None,
        typer.Option(
            parser=day_or_time,
            metavar="TIME",
            help="Day, or local time as 2026-01-31T14:05; now by default.",
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
) -> Entered:
    """Enter an adjustment: a change that may affect the indication of a piece of equipment.

    Earlier calibrations aren't valid after an adjustment.
    """
    from torquebench.records import Adjustment, Registry

    moment = performed_at(performed)
    with Registry.open(data_directory(data)) as registry:
        _known(registry, kind, serial)
        registry.add_adjustment(
            Adjustment(
                kind=kind.value,
                serial=serial,
                what=_named(what, "what was done"),
                performed=moment,
                performed_by=_named(by, "who has done it"),
                checked_by=checked_by,
                reason=reason,
                before=named_values(before, "--before", "span_hz=30000"),
                after=named_values(after, "--after", "span_hz=30000"),
            )
        )
        newest = registry.calibrations(serial, limit=1) if kind is Kind.transducer else []
    record = f"adjustment of {kind.value} {serial}"
    return Entered(
        headline=Message("{record} entered: {what}", record, what),
        remarks=tuple(
            f"calibration-{entry.calibration_id} was made before it: calibrate again"
            for entry in newest
            if entry.performed <= moment
        ),
        record=record,
    )


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


def equipment(serial: SerialArgument, data: DataOption = DEFAULT_DATA) -> ShownEquipment:
    """Show a piece of equipment: parts, certificates, adjustments and calibrations."""
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        found = registry.equipment(serial=serial)
        if not found:
            raise InputError(
                Message("no equipment {serial!r}", serial), "one of `records list equipment`"
            )
        return ShownEquipment(
            headline=Message("Equipment {serial}", serial),
            equipment=[_everything(registry, each) for each in found],
            facts=[(f"{each.kind} {each.serial}", _facts(registry, each)) for each in found],
        )


def _facts(registry: Registry, shown: Equipment) -> list[tuple[str, str]]:
    span = "" if shown.range_nm is None else f"{shown.range_nm:g} N·m"
    rows = [("type", f"{shown.manufacturer} {shown.model}".strip()), ("range", span)]
    rows += [(name, str(value)) for name, value in shown.details.items()]
    rows += [
        (part.role, f"{part.part[1]} since {part.fitted:%Y-%m-%d}")
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
            (f"calibration-{each.calibration_id}", f"{each.performed:%Y-%m-%d}, due {each.due}")
            for each in registry.calibrations(shown.serial)
        ]
    return rows


def _everything(registry: Registry, shown: Equipment) -> dict[str, Any]:
    certificates, adjustments = registry.reports(shown.serial), registry.adjustments(shown.serial)
    of_kind: dict[str, Any] = {
        "parts": registry.components((shown.kind, shown.serial)),
        "certificates": [each for each in certificates if each.kind == shown.kind],
        "adjustments": [each for each in adjustments if each.kind == shown.kind],
    }
    if shown.kind == "transducer":
        of_kind["calibrations"] = registry.calibrations(shown.serial)
    return {**asdict(shown), **of_kind}


def _known(registry: Registry, kind: Kind, serial: str) -> None:
    if not registry.equipment(kind.value, serial):
        raise InputError(
            Message("{value} {serial!r} isn't entered", kind.value, serial),
            "one of `torquebench records list equipment`",
            Message("torquebench records add-equipment {value} {serial}", kind.value, serial),
        )


def _named(text: str, what: str = "a serial number") -> str:
    if not text.strip():
        raise InputError(Message("no {what}", what), "a text that isn't empty")
    return text
