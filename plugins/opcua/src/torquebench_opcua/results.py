"""Results by OPC 40001-101: finished runs and files of certificates, with verdict and values."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any

from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.service import MEDIA, RecordQueries
from torquebench.records import CertificateEntry, RunSummary
from torquebench.uncertainty import Verdict

__all__ = [
    "Condition",
    "Outcome",
    "Quantity",
    "ResultReader",
    "ResultRecord",
    "condition",
    "field_value",
    "ordered",
    "outcome_of",
    "result_file",
]

MOST_RESULTS = 200
EVALUATIONS = ("Undefined", "OK", "NotOK", "NotDecidable")
_OF_VERDICT = {
    Verdict.NONE: "Undefined",
    Verdict.PASS: "OK",
    Verdict.CONDITIONAL_PASS: "NotDecidable",
    Verdict.CONDITIONAL_FAIL: "NotDecidable",
    Verdict.FAIL: "NotOK",
}


@dataclass(frozen=True)
class Quantity:
    """A value of a reducer test; `verdict` and `limit` are empty without a limit."""

    key: str
    title: str
    value: float
    expanded_uncertainty: float | None
    unit: str
    limit: str
    verdict: str


@dataclass(frozen=True)
class ResultRecord:
    """One result: a finished run, or a file of a certificate.

    Attributes
    ----------
    result_id : str
        A run's identifier, or ``NUMBER/FILE`` of a certificate.
    created : datetime.datetime
    part_id : str
        Serial number of the tested specimen or the calibrated transducer, if known.
    kind : str
        Kind of the run, or "certificate".
    simulated : bool
    evaluation : str
        One of `EVALUATIONS`.
    details : str
        The evaluation's statement, in words.
    file_format : str
        Media type of the file, empty where there is none.
    quantities : tuple of Quantity
        Quantities of a reducer test.
    """

    result_id: str
    created: datetime
    part_id: str
    kind: str
    simulated: bool
    evaluation: str = "Undefined"
    details: str = ""
    file_format: str = ""
    quantities: tuple[Quantity, ...] = ()

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


@dataclass(frozen=True)
class Outcome:
    """What doesn't change any more of a finished run."""

    part_id: str = ""
    evaluation: str = "Undefined"
    details: str = ""
    quantities: tuple[Quantity, ...] = ()


def outcome_of(results: Any) -> Outcome:
    """Return the outcome in the ``results.json`` of a reducer test.

    Examples
    --------
    >>> outcome_of({"serial": "S-1", "quantities": [{"key": "backlash", "title": "backlash",
    ...     "value": 0.6, "unit": "arcmin", "limit": "≤ 1 arcmin", "verdict": "pass"}]}).evaluation
    'OK'
    """
    if not isinstance(results, Mapping):
        return Outcome()
    quantities = tuple(
        Quantity(
            str(row["key"]),
            str(row["title"]),
            float(row["value"]),
            row.get("expanded_uncertainty"),
            str(row.get("unit") or ""),
            str(row.get("limit") or ""),
            str(row.get("verdict") or ""),
        )
        for row in results.get("quantities") or ()
        if row.get("value") is not None
    )
    verdict = Verdict.worst(each.verdict for each in quantities)
    limited = [each for each in quantities if each.limit and each.verdict == verdict]
    details = "; ".join(
        f"{each.title} {each.value:.4g} {each.unit} ({each.limit})" for each in limited[:5]
    )
    severe = [
        str(each.get("message")) for each in results.get("findings") or () if each.get("severe")
    ]
    if severe:
        evaluation, details = "NotDecidable", "; ".join(severe)
    else:
        evaluation = _OF_VERDICT[verdict]
        details = f"{verdict.label}: {details}" if verdict else ""
    return Outcome(str(results.get("serial") or ""), evaluation, details, quantities)


class ResultReader:
    """Reads the newest results; of a run whose outcome is known only what may change."""

    def __init__(self) -> None:
        self._outcomes: dict[str, Outcome] = {}

    def newest(self, records: RecordQueries, limit: int = MOST_RESULTS) -> tuple[ResultRecord, ...]:
        """Return the newest results, the newest first."""
        calibrations = records.calibrations(limit=limit)
        serials = {entry.run_id: entry.transducer_serial for entry in calibrations}
        numbers = {entry.calibration_id: entry.transducer_serial for entry in calibrations}
        runs = [run for run in records.runs(limit=limit).runs if run.finished is not None]
        known = {run.run_id: self._outcome(records, run) for run in runs}
        self._outcomes = known
        results = [
            _of_run(records, run, known[run.run_id], serials.get(run.run_id, "")) for run in runs
        ]
        for entry in records.certificates()[:limit]:
            results += _of_certificate(entry, numbers.get(entry.calibration_id, ""))
        return tuple(sorted(results, key=lambda each: each.created, reverse=True)[:limit])

    def _outcome(self, records: RecordQueries, run: RunSummary) -> Outcome:
        outcome = self._outcomes.get(run.run_id)
        if outcome is not None:
            return outcome
        try:
            if run.kind.startswith("test-"):
                return outcome_of(records.run(run.run_id, check=False).results)
            if run.kind.startswith("check-"):
                for check in records.checks(run.run_id):
                    verdict = Verdict(check.verdict)
                    worst = f"{verdict.label}: {check.worst_percent_fs:.3g} % of full scale"
                    limit = f"(≤ {check.tolerance_percent_fs:g} %)"
                    return Outcome(
                        check.transducer_serial, _OF_VERDICT[verdict], f"{worst} {limit}"
                    )
        except (TorquebenchError, OSError, KeyError, TypeError, ValueError):
            return Outcome(evaluation="NotDecidable", details="its results can't be read")
        return Outcome()


def _of_run(records: RecordQueries, run: RunSummary, outcome: Outcome, serial: str) -> ResultRecord:
    assert run.finished is not None
    done = run.status == "completed"
    return ResultRecord(
        run.run_id,
        _utc(run.finished),
        outcome.part_id or serial,
        run.kind,
        run.simulated,
        outcome.evaluation if done else "NotDecidable",
        (outcome.details if done else "") or run.reason or run.status,
        MEDIA[".pdf"] if records.has_report(run.run_id) else "",
        outcome.quantities if done else (),
    )


def _of_certificate(entry: CertificateEntry, serial: str) -> Iterable[ResultRecord]:
    verdict = Verdict(entry.summary.get("verdict") or "")
    for name in entry.files:
        if PurePath(name).suffix in (".pdf", ".xml"):
            yield ResultRecord(
                f"{entry.number}/{name}",
                _utc(entry.issued),
                serial,
                "certificate",
                bool(entry.summary.get("simulated", False)),
                _OF_VERDICT[verdict],
                verdict.value or f"authorised by {entry.authorised_by}",
                MEDIA[PurePath(name).suffix],
            )


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


# -- filters ------------------------------------------------------------------------------------

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
        A field of the filter isn't known.
    """
    matching = [each for each in records if wanted is None or wanted(each)]
    for name in reversed(by):
        matching.sort(key=field_value(name))
    return matching[:most] if most else matching


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
