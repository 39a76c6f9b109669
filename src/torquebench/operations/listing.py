"""List and show records, and the audit log."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.operations.operation import WHOLE, Flag, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.records import find_run
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.records import ModelEntry, Registry, RunSummary, VerificationEntry

MOST_LISTED = 10**9
SHOWN_ELSEWHERE = (
    "event",
    "time",
    "bench",
    "run",
    "operator",
    "bench_time_s",
    "instrument",
    "command",
    "by",
    "side",
    "log_line",
    "previous_sha256",
    "sha256",
)


# -- list and show --------------------------------------------------------------------------


class _Line(ABC):
    """One line of a list; values that it can't show raise an error where they are read."""

    def __post_init__(self) -> None:
        self.row()

    @abstractmethod
    def row(self) -> tuple[str, ...]:
        """Return the cells of a list."""


@dataclass(frozen=True)
class ListedRun(_Line):
    """One run."""

    run: str
    started: datetime
    status: str
    bench: str
    simulated: bool

    def row(self) -> tuple[str, ...]:
        """Return the cells of a list."""
        bench = "simulated" if self.simulated else self.bench
        return self.run, _moment(self.started), self.status, bench


@dataclass(frozen=True)
class ListedCalibration(_Line):
    """One calibration."""

    name: str
    performed: datetime
    transducer: str
    points: int
    range_nm: float
    profile: str
    simulated: bool

    def row(self) -> tuple[str, ...]:
        """Return the cells of a list."""
        span = f"{self.range_nm:g} N·m"
        what = (self.transducer, str(self.points), span, self.profile)
        return self.name, _moment(self.performed), *what


@dataclass(frozen=True)
class ListedModel(_Line):
    """One model."""

    name: str
    created: datetime
    kind: str
    transducer: str
    range_nm: float
    in_use: bool
    simulated: bool

    def row(self) -> tuple[str, ...]:
        """Return the cells of a list."""
        span, used = f"{self.range_nm:g} N·m", "yes" if self.in_use else ""
        return self.name, _moment(self.created), self.kind, self.transducer, span, used


@dataclass(frozen=True)
class ListedEquipment(_Line):
    """One piece of equipment."""

    kind: str
    serial: str
    manufacturer: str
    model: str
    range_nm: float | None

    def row(self) -> tuple[str, ...]:
        """Return the cells of a list."""
        span = "" if self.range_nm is None else f"{self.range_nm:g} N·m"
        return self.kind, self.serial, f"{self.manufacturer} {self.model}".strip(), span


_HEADINGS = {
    "runs": ("run", "started (UTC)", "status", "bench"),
    "calibrations": ("name", "performed (UTC)", "transducer", "points", "range", "profile"),
    "models": ("name", "created (UTC)", "kind", "transducer", "range", "in use"),
    "equipment": ("kind", "serial", "what", "range"),
}


@dataclass(frozen=True, kw_only=True)
class ListedRecords(Result):
    """Content of the registry, the newest first; null is what wasn't listed.

    `more` names lists that go on, `problems` what couldn't be read.
    """

    more: Sequence[str]
    problems: Sequence[str]
    runs: Sequence[ListedRun] | None = None
    calibrations: Sequence[ListedCalibration] | None = None
    models: Sequence[ListedModel] | None = None
    equipment: Sequence[ListedEquipment] | None = None

    @property
    def failed(self) -> bool:
        """Whether something couldn't be read."""
        return bool(self.problems)

    def page(self) -> Page:
        """Return its description."""
        sections = []
        for name, header in _HEADINGS.items():
            rows = getattr(self, name)
            if rows is not None:
                cells = [
                    tuple("unknown" if cell is None else cell for cell in line.row())
                    for line in rows
                ]
                table = Table(header, cells, words=True)
                text = "" if rows else "none yet"
                sections.append(Section(name.capitalize(), text, [table] * bool(rows)))
        return Page("Records", "", sections)


@dataclass(frozen=True, kw_only=True)
class ShownRecord(Result):
    """One record: `facts` as printed, `record` as registered."""

    name: str
    facts: Mapping[str, str]
    record: Any
    verifications: Sequence[Any] = ()

    def page(self) -> Page:
        """Return its description."""
        blocks = [Facts([*self.facts.items()])]
        sections = [Section("", "", blocks), *map(_verification, self.verifications)]
        return Page(self.headline, "", sections)


class ListRequest(Request):
    """List runs, calibrations, models and equipment, newest first."""

    kind: Annotated[
        Literal["all", "runs", "calibrations", "models", "equipment"],
        field("What to list.", argument=True),
    ] = "all"
    limit: Annotated[int, field("Largest number of rows of each kind.", ge=1, le=10**9), WHOLE] = 20
    all: Annotated[Flag, field("All of them.")] = False


def run_list(place: Place, request: ListRequest, _progress: Progress) -> ListedRecords:
    """List the chosen kinds; what can't be read is named."""
    from torquebench.records import unfinished_runs

    limit = MOST_LISTED if request.all else request.limit
    listed: dict[str, Any] = {}
    problems: list[str] = []
    unfinished: list[str] = []
    for kind, rows_of in _LISTS.items():
        if request.kind in (kind, "all"):
            listed[kind] = []
            with _named_problems(problems):
                listed[kind] = rows_of(place.registry, limit + 1, problems)
    with _named_problems(problems):
        if "runs" in listed:
            unfinished = [
                Message("{found}: {remedy}", run.found, run.remedy)
                for run in unfinished_runs(place.registry)
            ]
    problems = list(dict.fromkeys(problems))
    more = [name for name, rows in listed.items() if len(rows) > limit]
    return ListedRecords(
        headline=Message("There are more than these {limit}: --limit NUMBER, or --all", limit)
        if more
        else "Records",
        remarks=(
            *unfinished,
            *(Message("{problem}; see `torquebench records verify`", each) for each in problems),
        ),
        more=more,
        problems=problems,
        **{name: rows[:limit] for name, rows in listed.items()},
    )


@contextmanager
def _named_problems(problems: list[str]) -> Iterator[None]:
    """Collect errors of unreadable entries, and continue."""
    from torquebench.records.files import UNREADABLE

    try:
        yield
    except RecordError as error:
        problems.append(error.found)
    except UNREADABLE as error:
        problems.append(f"{type(error).__name__}: {error}")


class ShowRequest(Request):
    """Show one record, and check its files against their hashes."""

    name: Annotated[
        str,
        field(
            "A run's id or its beginning, `latest`, `model-3`, `calibration-2`.",
            title="Record",
            argument=True,
            min_length=1,
            max_length=100,
            examples=("calibration-2",),
        ),
    ]


def run_show(place: Place, request: ShowRequest, _progress: Progress) -> ShownRecord:
    """Show a run, a model or a calibration."""
    kind, _, number = request.name.rpartition("-")
    if kind not in ("model", "calibration") or not number.isdecimal():
        return _show_run(find_run(place.registry, request.name))
    try:
        return (_show_model if kind == "model" else _show_calibration)(place.registry, int(number))
    except RecordError as error:
        raise InputError(
            Message("no record {name!r}", request.name), "a name from `torquebench records list`"
        ) from error


def _run(run: RunSummary) -> ListedRun:
    return ListedRun(run.run_id, run.started, run.status, run.bench, run.simulated)


def _list_runs(registry: Registry, limit: int, problems: list[str]) -> list[ListedRun]:
    return [_run(run) for run in registry.runs(limit=limit, problems=problems)]


def _list_calibrations(
    registry: Registry, limit: int, problems: list[str]
) -> list[ListedCalibration]:
    return [
        ListedCalibration(
            f"calibration-{entry.calibration_id}",
            entry.performed,
            entry.transducer_serial,
            entry.points,
            entry.range_nm,
            entry.profile_name,
            entry.simulated,
        )
        for entry in registry.calibrations(limit=limit, problems=problems)
    ]


def _list_models(registry: Registry, limit: int, problems: list[str]) -> list[ListedModel]:
    return [
        ListedModel(
            f"model-{entry.model_id}",
            entry.created,
            entry.kind,
            entry.transducer_serial,
            entry.range_nm,
            entry.active,
            entry.simulated,
        )
        for entry in registry.models(limit=limit, problems=problems)
    ]


def _list_equipment(registry: Registry, _limit: int, _problems: list[str]) -> list[ListedEquipment]:
    return [
        ListedEquipment(entry.kind, entry.serial, entry.manufacturer, entry.model, entry.range_nm)
        for entry in registry.equipment()
    ]


_LISTS: Mapping[str, Callable[[Registry, int, list[str]], Sequence[Any]]] = {
    "runs": _list_runs,
    "calibrations": _list_calibrations,
    "models": _list_models,
    "equipment": _list_equipment,
}


def _show_run(run: RunSummary) -> ShownRecord:
    from torquebench.records import RunFolder
    from torquebench.records.runs.time_check import times_of_run

    folder = RunFolder.open(run.folder)
    return _shown(
        run.run_id,
        {
            "kind": run.kind,
            "status": (
                Message("{status} ({reason})", run.status, run.reason) if run.reason else run.status
            ),
            "bench": Message("{bench} (simulated)", run.bench) if run.simulated else run.bench,
            "side": run.side,
            "operator": run.operator,
            "started": _moment(run.started),
            "finished": _moment(run.finished),
            "times": times_of_run(run),
            "profile": run.profile_name,
            "profile SHA-256": run.profile_sha256,
            "software": run.software_version,
            "events": str(sum(1 for _ in folder.documents("event"))),
            "raw samples": str(folder.raw().rows),
            "files": _state_of(folder),
            "folder": str(run.folder),
        },
        run,
    )


def _state_of(folder: Any) -> str:
    if not folder.sealed:
        state = "not sealed: the run is open, or was interrupted"
        return Message.joined([state, *(f"events.jsonl {each}" for each in folder.damages)], "; ")
    try:
        folder.verify()
    except RecordError as error:
        return Message("NOT INTACT: {error}", Message.of(error))
    return "intact (every SHA-256 as in the manifest)"


def _show_model(registry: Registry, model_id: int) -> ShownRecord:
    entry = registry.model(model_id)
    try:
        state = Message("intact, {file}", entry.check_file())
    except RecordError as error:
        state = Message("NOT INTACT: {error}", Message.of(error))
    return _shown(
        f"model-{entry.model_id}",
        {
            "kind": entry.kind,
            "fitted to": f"calibration-{entry.calibration_id}",
            "side": entry.side,
            "transducer": entry.transducer_serial,
            "counter": entry.counter_identity,
            "range": f"{entry.range_nm:g} N·m",
            "created": _moment(entry.created),
            "in use": _use(registry, entry),
            "data": "simulated" if entry.simulated else "measured",
            "file": state,
            **{
                key: _short(value)
                for key, value in entry.metrics.items()
                if key != "contradictions"
            },
            "contradictions": Message.joined(map(str, entry.contradictions), "; "),
        },
        entry,
        registry.verifications(model_id),
    )


def _use(registry: Registry, model: ModelEntry) -> str:
    """State whether a model is in use, who activated it and how the person was authenticated."""
    from torquebench.records.signatures import how

    if not model.active:
        return "no"
    latest = registry.activations(model.transducer_serial)
    used = next((each for each in reversed(latest) if each.model_id == model.model_id), None)
    if used is None:
        return "yes"
    return Message(
        "yes, since {moment}, {who}, {how}",
        _moment(used.activated), used.operator or "–", how(used.signature),
    )  # fmt: skip


def _verification(verification: VerificationEntry) -> Section:
    """Describe a verification's errors before and after compensation."""
    from torquebench.calibration import ErrorSummary
    from torquebench.campaign.fitting import model_title
    from torquebench.reports.errors_table import errors_table

    models = verification.summary["models"]
    blocks = [
        errors_table(
            [
                (model_title(model["name"]), ErrorSummary(**model[key]))
                for model in models
                if model[key] is not None
            ],
            caption,
        )
        for key, caption in (
            ("against_standard", "Single readings against the standard."),
            ("against_truth", "Single readings against the true torque."),
            ("averaged", "Averaged over the groups."),
        )
        if any(model[key] is not None for model in models)
    ]
    heading = Message(
        "Verified {moment}, simulated" if verification.simulated else "Verified {moment}",
        _moment(verification.performed),
    )
    text = Message("run {run}", verification.run_id) if verification.run_id else ""
    return Section(heading, text, blocks)


def _show_calibration(registry: Registry, calibration_id: int) -> ShownRecord:
    from torquebench.campaign.fitting import model_title
    from torquebench.records.signatures import how

    entry = registry.calibration(calibration_id)
    models = registry.models(calibration_id=calibration_id)
    reviews = registry.reviews("calibrations", calibration_id)
    amendments = registry.amendments("calibrations", calibration_id)
    certificates = registry.certificates(calibration_id)
    low, high = entry.valid_nm
    return _shown(
        f"calibration-{entry.calibration_id}",
        {
            "performed": _moment(entry.performed),
            "transducer": entry.transducer_serial,
            "counter": entry.counter_identity,
            "standard": entry.standard_serial,
            "measured by": Message("{who}, {how}", entry.measured_by, how(entry.signature)),
            "checked by": Message.joined([_review(each) for each in reviews], "; "),
            "range": f"{entry.range_nm:g} N·m",
            "valid": Message("{low:.6g} to {high:.6g} N·m", low, high),
            "due": "" if entry.due is None else entry.due.isoformat(),
            "points": str(entry.points),
            "mean temperature": (
                "" if entry.temperature_c is None else f"{entry.temperature_c:.1f} °C"
            ),
            "profile": entry.profile_name,
            "profile SHA-256": entry.profile_sha256,
            "data": "simulated" if entry.simulated else "measured",
            "data SHA-256": entry.data_sha256,
            "run": entry.run_id or "an external table",
            "models": Message.joined(
                [
                    Message("model-{number} ({title})", each.model_id, model_title(each.kind))
                    for each in models
                ]
            ),
            "certificates": ", ".join(each.number for each in certificates),
            **{
                f"amended {_moment(each.amended)}": f"{_changes(each.changes)} "
                f"({each.amended_by}: {each.reason})"
                for each in amendments
            },
            **{key: _short(value) for key, value in entry.summary.items()},
        },
        entry,
    )


def _review(review: Any) -> str:
    """State who has checked a record, when, and with which outcome."""
    from torquebench.records.signatures import how

    who = Message("{who}, {moment}", review.checked_by, _moment(review.checked))
    said = Message("{who}, {how}", who, how(review.signature))
    if not review.accepted:
        said = Message("{act}, not accepted", said)
    return Message("{act} ({remark})", said, review.remark) if review.remark else said


def _changes(changes: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in changes.items())


def _shown(
    title: str,
    facts: Mapping[str, str],
    record: object,
    verifications: Sequence[VerificationEntry] = (),
) -> ShownRecord:
    return ShownRecord(
        headline=title,
        name=title,
        facts={key: value for key, value in facts.items() if value},
        record=record,
        verifications=verifications,
    )


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values"
    if isinstance(value, Mapping):
        return Message.joined(
            [Message("{name} {value}", name, _short(item)) for name, item in value.items()]
        )
    return str(value)


def _moment(moment: datetime | None) -> str:
    return "" if moment is None else f"{moment:%Y-%m-%d %H:%M:%S}"


# -- audit log ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class AuditLines(Result):
    """Lines of the audit log as they are written in its files; `earlier` ones aren't in `lines`."""

    lines: Sequence[Mapping[str, Any]]
    earlier: int

    def page(self) -> Page:
        """Return its description."""
        table = Table(
            ("time (UTC)", "bench s", "by", "what"), [_cells(each) for each in self.lines]
        )
        return Page("Audit log", "", [Section("", "", [table] * bool(self.lines))])


class AuditRequest(Request):
    """Show the audit log: every command to drives, modes and clamp, alarms, runs.

    Each line is bound to bench, run and operator. The files are JSON lines: audit/audit.jsonl in
    the data directory, and audit.jsonl in each run's folder.
    """

    run: Annotated[
        str | None,
        field(
            "A run's id or its beginning, or `latest`; without it the whole log.",
            argument=True,
            max_length=100,
        ),
    ] = None
    limit: Annotated[
        int, field("Largest number of lines, the newest ones.", ge=1, le=10**6), WHOLE
    ] = 40
    alarms: Annotated[Flag, field("Only alarms and acknowledgements.")] = False


def run_audit(place: Place, request: AuditRequest, _progress: Progress) -> AuditLines:
    """Return the newest lines of the log."""
    from torquebench.bench.audit.chain import AUDIT_FILE
    from torquebench.bench.audit.entries import AUDIT_FOLDER, read_audit

    path = place.registry.root / AUDIT_FOLDER
    if request.run is not None:
        path = find_run(place.registry, request.run).folder / AUDIT_FILE
    lines = [
        line for line in read_audit(path) if not request.alarms or "alarm" in str(line.get("event"))
    ]
    earlier = max(len(lines) - request.limit, 0)
    headline = Message("{count} lines.", len(lines))
    if not lines:
        headline = Message("no {what} in the audit log", "alarm" if request.alarms else "line")
    elif earlier:
        headline = Message(
            "{count} lines before these; see --limit, or read {path}.", earlier, path
        )
    return AuditLines(headline=headline, lines=lines[-request.limit :], earlier=earlier)


def _cells(line: Mapping[str, Any]) -> tuple[str, str, str, str]:
    what = str(line.get("command") or line.get("event"))
    side = f"{line['side']} " if line.get("side") else ""
    values = ", ".join(
        f"{key}={_short(value)}"
        for key, value in line.items()
        if key not in SHOWN_ELSEWHERE and value not in ("", None, [])
    )
    if line.get("event") not in ("command", what):
        what = f"{line['event']}: {what}"
    return (
        str(line.get("time", ""))[11:23],
        f"{float(line.get('bench_time_s', 0.0)):.2f}",
        str(line.get("by", "")),
        f"{side}{what}{f' ({values})' if values else ''}",
    )


# -- operations -----------------------------------------------------------------------------

LIST = Operation(
    "records list",
    ListRequest,
    run_list,
    lambda request: Message("List {kind}", request.kind),
    quick=True,
)
SHOW = Operation(
    "records show",
    ShowRequest,
    run_show,
    lambda request: Message("Show {name}", request.name),
    quick=True,
)
AUDIT = Operation(
    "records audit", AuditRequest, run_audit, lambda _request: "Audit log", quick=True
)
