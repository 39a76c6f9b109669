"""`torquebench records`: list and show measured, fitted and verified records."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.audit import audit
from torquebench.cli.equipment import add_certificate, add_equipment, adjust, equipment, fit_part
from torquebench.cli.export import export
from torquebench.cli.export_data import export_data
from torquebench.cli.options import (
    DEFAULT_DATA,
    HELP_MARKUP,
    REGISTRY_FILE,
    REGISTRY_URL,
    DataOption,
    data_directory,
    numbered,
)
from torquebench.cli.records.backup import backup, rebuild, restore
from torquebench.cli.records.checks import amend, verify
from torquebench.cli.recovered import tell_unfinished
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.operations.result import Result
from torquebench.reports.page import Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.records import ModelEntry, Registry, RunSummary, VerificationEntry
    from torquebench.records.runs.listing import RunLine

__all__ = ["app"]

app = typer.Typer(
    name="records",
    help="List and show the registry's contents.",
    rich_markup_mode=HELP_MARKUP,
    no_args_is_help=True,
)

for command in (
    verify,
    amend,
    backup,
    restore,
    rebuild,
    export,
    export_data,
    audit,
    equipment,
    add_equipment,
    add_certificate,
    fit_part,
    adjust,
):
    app.command()(command)


class Kind(StrEnum):
    """Kinds of lists."""

    all = "all"
    runs = "runs"
    calibrations = "calibrations"
    models = "models"
    equipment = "equipment"


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


@app.command("list")
def list_records(
    kind: Annotated[Kind, typer.Argument(help="What to list.")] = Kind.all,
    limit: Annotated[
        int, typer.Option(min=1, help="Largest number of rows of each kind, newest first.")
    ] = 20,
    everything: Annotated[bool, typer.Option("--all", help="All of them.")] = False,
    data: DataOption = DEFAULT_DATA,
) -> ListedRecords:
    """List runs, calibrations, models and equipment, newest first."""
    folder = data_directory(data)
    limit = MOST_LISTED if everything else limit
    listed: dict[str, Any] = {}
    problems: list[str] = []
    if kind is Kind.runs and (runs := _runs_at_once(folder, limit + 1)) is not None:
        listed["runs"] = [_run(run) for run in runs]
    else:
        from torquebench.records import Registry, unfinished_runs

        with Registry.open(folder) as registry:
            for item in Kind:
                if item is not Kind.all and kind in (item, Kind.all):
                    listed[item.value] = []
                    with _named_problems(problems):
                        listed[item.value] = _LISTS[item](registry, limit + 1, problems)
            with _named_problems(problems):
                if "runs" in listed:
                    tell_unfinished(list(unfinished_runs(registry)))
    problems = list(dict.fromkeys(problems))
    more = [name for name, rows in listed.items() if len(rows) > limit]
    return ListedRecords(
        headline=f"There are more than these {limit}: --limit NUMBER, or --all" if more else "",
        remarks=tuple(f"{problem}; see `torquebench records verify`" for problem in problems),
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


def _runs_at_once(folder: Path, limit: int) -> Sequence[RunLine] | None:
    """Return the newest runs directly from the SQLite file, without opening the registry.

    None if the file isn't a registry of this version, or if a run may be unfinished.
    """
    if os.environ.get(REGISTRY_URL):
        return None
    from torquebench.records.runs.listing import maybe_unfinished, newest_runs

    file = folder / REGISTRY_FILE
    return None if maybe_unfinished(file) else newest_runs(file, limit)


@app.command("show")
def show_record(
    name: Annotated[
        str,
        typer.Argument(help="A run's id or its beginning, `latest`, `model-3`, `calibration-2`."),
    ],
    data: DataOption = DEFAULT_DATA,
) -> ShownRecord:
    """Show one record, and check its files against their hashes."""
    from torquebench.operations.records import find_run
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        named = numbered(name, "model", "calibration")
        if named is None:
            return _show_run(find_run(registry, name))
        kind, number = named
        return (_show_model if kind == "model" else _show_calibration)(registry, number)


def _run(run: RunLine | RunSummary) -> ListedRun:
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


_LISTS = {
    Kind.runs: _list_runs,
    Kind.calibrations: _list_calibrations,
    Kind.models: _list_models,
    Kind.equipment: _list_equipment,
}


MOST_LISTED = 10**9


def _show_run(run: RunSummary) -> ShownRecord:
    from torquebench.records import RunFolder
    from torquebench.records.runs.time_check import times_of_run

    folder = RunFolder.open(run.folder)
    return _shown(
        run.run_id,
        {
            "kind": run.kind,
            "status": run.status + (f" ({run.reason})" if run.reason else ""),
            "bench": run.bench + (" (simulated)" if run.simulated else ""),
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
        damaged = "".join(f"; events.jsonl {damage}" for damage in folder.damages)
        return f"not sealed: the run is open, or was interrupted{damaged}"
    try:
        folder.verify()
    except RecordError as error:
        return f"NOT INTACT: {error}"
    return "intact (every SHA-256 as in the manifest)"


def _show_model(registry: Registry, model_id: int) -> ShownRecord:
    try:
        entry = registry.model(model_id)
    except RecordError as error:
        raise InputError(
            Message("no record 'model-{model_id}'", model_id),
            "a name from `torquebench records list`",
        ) from error
    try:
        state = f"intact, {entry.check_file()}"
    except RecordError as error:
        state = f"NOT INTACT: {error}"
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
            "contradictions": "; ".join(str(each) for each in entry.contradictions),
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
    return f"yes, since {_moment(used.activated)}, {used.operator or '-'}, {how(used.signature)}"


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
    marked = " - simulated" if verification.simulated else ""
    text = f"run {verification.run_id}" if verification.run_id else ""
    return Section(f"Verified {_moment(verification.performed)}{marked}", text, blocks)


def _show_calibration(registry: Registry, calibration_id: int) -> ShownRecord:
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
            "measured by": f"{entry.measured_by}, {how(entry.signature)}",
            "checked by": "; ".join(
                f"{each.checked_by}, {_moment(each.checked)}"
                f"{'' if each.accepted else ', not accepted'}, {how(each.signature)}"
                f"{f' ({each.remark})' if each.remark else ''}"
                for each in reviews
            ),
            "range": f"{entry.range_nm:g} N·m",
            "valid": f"{low:.6g} to {high:.6g} N·m",
            "due": "" if entry.due is None else entry.due.isoformat(),
            "points": str(entry.points),
            "profile": entry.profile_name,
            "profile SHA-256": entry.profile_sha256,
            "data": "simulated" if entry.simulated else "measured",
            "data SHA-256": entry.data_sha256,
            "run": entry.run_id or "an external table",
            "models": ", ".join(f"model-{m.model_id} ({m.kind})" for m in models),
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
        return f"{value:.6g}"
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_short(item)}" for name, item in value.items())
    return str(value)


def _moment(moment: datetime | None) -> str:
    return "" if moment is None else f"{moment:%Y-%m-%d %H:%M:%S}"
