"""Requests of operations that read tables of torques, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import Number, Request, field
from torquebench.reports.page import Facts

if TYPE_CHECKING:
    from torquebench.tables import CalibrationTable, Conversion, Understood
    from torquebench.uncertainty import CertifiedUncertainty


LARGEST_NM = 1e9
Range = Annotated[
    Number | None, field("Full scale in N·m, the reference of % FS.", gt=0, le=LARGEST_NM)
]
Reference = Annotated[
    str | None,
    field(
        "U (k = 2) of the reference standard, instead of the one stated in a file: in % as `0.02 "
        "of torque` or `0.02 of range`, or the file of its certificate: a digital one (XML) or a "
        "table with torque_nm and expanded_uncertainty_nm.",
        file=True,
        max_length=300,
        examples=("0.02 of torque",),
    ),
]
Without = Annotated[
    tuple[str, ...],
    field(
        "Don't correct hysteresis, temperature, rotation, inertia or ripple: U contains it "
        "instead. May be repeated.",
    ),
]


def day_or_time(text: Any) -> date:
    """Parse a day, or a time if the text contains one."""
    if isinstance(text, date):
        return text
    try:
        text = str(text).strip()
        try:
            return date.fromisoformat(text)
        except ValueError:
            moment = datetime.fromisoformat(text)
            moment.astimezone(UTC)
            return moment
    except (ValueError, OverflowError):
        raise ValueError(
            "a day such as 2026-01-31, or 2026-01-31T14:05 (local time), or 2026-01-31T14:05+01:00"
        ) from None


DayOrTime = Annotated[
    Any, PlainValidator(day_or_time), WithJsonSchema({"type": "string", "format": "date"})
]
"""A day or a time as text; see `torquebench.validation.past_moment`."""


class TorqueTable(Request):
    """Base of requests that read a table of torques."""

    column: Annotated[
        tuple[str, ...],
        field(
            "Assigns a header to a quantity, as in reading=Drehmoment[Nm]; a minus sign before "
            "the header reverses the sign. May be repeated.",
        ),
    ] = ()
    sensitivity: Annotated[
        str | None,
        field(
            "Sensitivity of readings in mV/V, V, mA, Hz or counts: `2.0015 mV/V at 500 Nm`, `50 Nm "
            "per V`, or two points, `10 kHz at 0 Nm; 15 kHz at 500 Nm`.",
        ),
    ] = None
    arm: Annotated[str | None, field("Lever arm of forces and masses, as 0.5m or 20in.")] = None
    gravity: Annotated[
        Number | None,
        field(
            "Local acceleration of free fall for masses; 9.80665 by default.",
            unit="m/s²",
        ),
    ] = None

    def conversion(self) -> Conversion:
        """Check these fields, and return the conversion that they define."""
        from torquebench.tables import Conversion

        return Conversion.of_options(self.sensitivity, self.arm, self.gravity)

    def calibration(
        self, file: Path, remark: Callable[[str], None], **options: Any
    ) -> CalibrationTable:
        """Read a calibration; see `torquebench.tables.read_calibration_table`."""
        from torquebench.tables import read_calibration_table

        options.setdefault("mapping", self.column)
        read = read_calibration_table(file, remark=remark, conversion=self.conversion(), **options)
        for note in dict.fromkeys(read.columns.notes):
            remark(note)
        if read.data.range_nm > LARGEST_NM:
            raise InputError(
                Message("a range of {range:g} N·m", read.data.range_nm),
                Message("at most {allowed:g} N·m", LARGEST_NM),
            )
        return read


def columns_fact(*understood: Understood) -> list[Facts]:
    """Describe how columns with foreign names or units were understood."""
    sentences = [sentence for each in understood if (sentence := each.sentence())]
    return [Facts([("Columns", sentence) for sentence in sentences])] * bool(sentences)


def stated_reference(
    stated: str | None, range_nm: float, side: str = "", *, option: str = "--reference"
) -> CertifiedUncertainty | None:
    """Return a standard's U as a function of torque, by `Reference`; None without it."""
    if stated is None:
        return None
    from torquebench.bench.certificates.torque import read_uncertainty
    from torquebench.uncertainty import CertifiedUncertainty

    try:
        float(stated.partition(" of ")[0].rstrip("% "))
    except ValueError:
        return read_uncertainty(stated, side)
    try:
        return CertifiedUncertainty.of_words(stated, range_nm)
    except InputError as error:
        raise InputError(
            Message("{option}: {error}", option, error.found),
            error.allowed,
            error.remedy,
        ) from error
