"""Results by OPC 40001-101 from the service's records; pure except for reading them."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.service.records.queries import MEDIA, RecordQueries
from torquebench.records import CertificateEntry, RunSummary
from torquebench.uncertainty import Verdict

__all__ = [
    "Condition",
    "ResultRecord",
    "condition",
    "field_value",
    "ordered",
    "result_file",
    "result_records",
]

MOST_RESULTS = 200
EVALUATIONS = ("Undefined", "OK", "NotOK", "NotDecidable")


@dataclass(frozen=True)
class ResultRecord:
    """One result: a finished run, or a file of a certificate.

    Attributes
    ----------
    result_id : str
        A run's identifier, or ``NUMBER/FILE`` of a certificate.
    created : datetime.datetime
    part_id : str
        Serial number of the calibrated equipment, if known.
    kind : str
        Kind of the run, or "certificate".
    simulated : bool
    evaluation : str
        One of `EVALUATIONS`.
    details : str
        The evaluation's statement, in words.
    file_format : str
        Media type of the file, empty where there is none.
    """

    result_id: str
    created: datetime
    part_id: str
    kind: str
    simulated: bool
    evaluation: str = "Undefined"
    details: str = ""
    file_format: str = ""

    @property
    def field_values(self) -> dict[str, Any]:
        """Values of the metadata's fields, by the specification's names."""
        return {
            "ResultId": self.result_id,
            "HasTransferableDataOnFile": bool(self.file_format),
            "IsPartial": False,
            "IsSimulated": self.simulated,
            "PartId": self.part_id,
            "InternalRecipeId": self.kind,
            "CreationTime": self.created,
            "ResultEvaluation": EVALUATIONS.index(self.evaluation),
            "FileFormat": [self.file_format] if self.file_format else [],
        }


def result_records(records: RecordQueries, limit: int = MOST_RESULTS) -> tuple[ResultRecord, ...]:
    """Return the newest results, the newest first."""
    calibrations = records.calibrations(limit=limit)
    serials = {entry.run_id: entry.transducer_serial for entry in calibrations}
    numbers = {entry.calibration_id: entry.transducer_serial for entry in calibrations}
    found = [
        _of_run(records, run, serials.get(run.run_id, ""))
        for run in records.runs(limit=limit).runs
        if run.finished is not None
    ]
    for entry in records.certificates()[:limit]:
        found += _of_certificate(entry, numbers.get(entry.calibration_id, ""))
    return tuple(sorted(found, key=lambda each: each.created, reverse=True)[:limit])


def _of_run(records: RecordQueries, run: RunSummary, serial: str) -> ResultRecord:
    assert run.finished is not None
    file_format = MEDIA[".pdf"] if records.has_report(run.run_id) else ""
    done = run.status == "completed"
    return ResultRecord(
        run.run_id,
        _utc(run.finished),
        serial,
        run.kind,
        run.simulated,
        "Undefined" if done else "NotDecidable",
        run.reason or run.status,
        file_format,
    )


_VERDICTS = {Verdict.PASS: "OK", Verdict.FAIL: "NotOK", Verdict.NONE: "Undefined"}


def _of_certificate(entry: CertificateEntry, serial: str) -> list[ResultRecord]:
    verdict = Verdict(entry.summary.get("verdict") or "")
    return [
        ResultRecord(
            f"{entry.number}/{name}",
            _utc(entry.issued),
            serial,
            "certificate",
            bool(entry.summary.get("simulated", False)),
            _VERDICTS.get(verdict, "NotDecidable"),
            verdict.value or f"authorised by {entry.authorised_by}",
            MEDIA[PurePath(name).suffix],
        )
        for name in entry.files
        if PurePath(name).suffix in (".pdf", ".xml")
    ]


def _utc(moment: datetime) -> datetime:
    return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)


def result_file(records: RecordQueries, result_id: str) -> tuple[bytes, str]:
    """Return a result's file and its name, checked as the records do.

    Raises
    ------
    NotFoundError
        There is no such result, or it has no file.
    RecordError
        The file is missing or was changed.
    """
    number, slash, name = result_id.rpartition("/")
    if slash:
        content, _ = records.certificate_file(number, name)
        return content, name
    return records.report_file(result_id), f"{result_id}.pdf"


Condition = Callable[[ResultRecord], Any]
"""Value of a filter's element or operand for a result."""

_OPERATORS: dict[str, tuple[int, Callable[..., bool]]] = {
    "And": (2, lambda a, b: bool(a) and bool(b)),
    "Or": (2, lambda a, b: bool(a) or bool(b)),
    "Not": (1, lambda a: not a),
    "Between": (3, lambda a, low, high: low <= a <= high),
    "IsNull": (1, lambda a: a is None),
    "Equals": (2, lambda a, b: a == b),
    "GreaterThan": (2, lambda a, b: a > b),
    "LessThan": (2, lambda a, b: a < b),
    "GreaterThanOrEqual": (2, lambda a, b: a >= b),
    "LessThanOrEqual": (2, lambda a, b: a <= b),
    "Like": (
        2,
        lambda a, b: fnmatch.fnmatchcase(str(a), str(b).replace("%", "*").replace("_", "?")),
    ),
    "InList": (0, lambda a, *others: a in others),
}
"""Number of operands, 0 for two and more, and the comparison of their values."""


def condition(operator: str, operands: Sequence[Condition]) -> Condition:
    """Return a filter element as a function of a result.

    Raises
    ------
    InputError
        When the operator isn't known or has the wrong number of operands.
    """
    count, comparison = _OPERATORS.get(operator, (-1, bool))
    if len(operands) != count and not (count == 0 and len(operands) > 1):
        raise InputError(
            Message("filter {operator} with {count} operands", operator, len(operands)),
            ", ".join(_OPERATORS),
        )
    return lambda result: _compared(comparison, [operand(result) for operand in operands])


def _compared(comparison: Callable[..., bool], values: Sequence[Any]) -> bool:
    """Compare comparable values; values of different types don't match."""
    try:
        return comparison(
            *(_utc(value) if isinstance(value, datetime) else value for value in values)
        )
    except TypeError:
        return False


def ordered(
    records: Sequence[ResultRecord], wanted: Condition | None, by: Sequence[str], most: int
) -> list[ResultRecord]:
    """Return results that match a filter, in order of metadata fields.

    Raises
    ------
    InputError
        When a field isn't known.
    """
    found = [each for each in records if wanted is None or wanted(each)]
    for name in reversed(by):
        found.sort(key=lambda each: field_value(name)(each))
    return found[:most] if most else found


def field_value(name: str) -> Condition:
    """Return a metadata field as a function of a result.

    Raises
    ------
    InputError
        When it isn't one that results of this server have.
    """
    known = ResultRecord("", datetime.now(UTC), "", "", simulated=False).field_values
    if name not in known:
        raise InputError(Message("field {name!r} of a result", name), ", ".join(known))
    return lambda result: result.field_values[name]
