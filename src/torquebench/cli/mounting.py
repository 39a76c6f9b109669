"""The record of a mounting from the command line: `--mounting coaxiality_mm=0.012`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.options import named_values
from torquebench.cli.terminal.console import warn

if TYPE_CHECKING:
    from torquebench.bench.mounting_record import MountingRecord

__all__ = ["MountingOption", "mounting_record"]

MountingOption = Annotated[
    list[str] | None,
    typer.Option(
        "--mounting",
        metavar="NAME=VALUE",
        help="Data of the mounting for the record, the report and the certificate. "
        "May be repeated: coaxiality_mm, clamp_pressure_bar, duration_min, lubricant, "
        "lubricant_amount_g, lubricant_hours, by.",
    ),
]


def mounting_record(given: list[str] | None) -> MountingRecord | None:
    """Check and return the entered record; warn of a coaxiality error beyond the limit.

    Raises
    ------
    InputError
        A name is unknown or given twice, or a value is outside its limits.

    Examples
    --------
    >>> mounting_record(["coaxiality_mm=0.012", "lubricant=grease"]).coaxiality_mm
    0.012
    """
    if not given:
        return None
    from torquebench.bench.mounting_record import MountingRecord
    from torquebench.validation import validated

    values = named_values(given, "--mounting", "coaxiality_mm=0.012")
    record: MountingRecord = validated(MountingRecord, values, "--mounting")
    if record.doubt:
        warn(record.doubt)
    return record
