"""`torquebench records`: list and show measured, fitted and verified records."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.answers import LISTED_CALIBRATION, LISTED_EQUIPMENT, LISTED_MODEL, LISTED_RUN
from torquebench.cli.audit import audit
from torquebench.cli.equipment import add_certificate, add_equipment, adjust, equipment, fit_part
from torquebench.cli.export import export
from torquebench.cli.export_data import export_data
from torquebench.cli.failure import CHECK_FAILED
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
from torquebench.cli.terminal.console import answer, narrow_table, out, print_facts, say, warn
from torquebench.errors import InputError, RecordError
from torquebench.message import Message

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


@app.command("list")
def list_records(
    kind: Annotated[Kind, typer.Argument(help="What to list.")] = Kind.all,
    limit: Annotated[
        int, typer.Option(min=1, help="Largest number of rows of each kind, newest first.")
    ] = 20,
    everything: Annotated[bool, typer.Option("--all", help="All of them.")] = False,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """List runs, calibrations, models and equipment, newest first."""
    folder = data_directory(data)
    answer(more=[])
    limit = MOST_LISTED if everything else limit
    if kind is Kind.runs and (runs := _runs_at_once(folder, limit + 1)) is not None:
        _print_runs(runs, limit)
        return
    from torquebench.records import Registry, unfinished_runs

    with Registry.open(folder) as registry:
        wanted = [item for item in Kind if item is not Kind.all and kind in (item, Kind.all)]
        problems: list[str] = []
        for number, item in enumerate(wanted):
            if number:
                say("")
            with _named_problems(problems):
                _LISTS[item](registry, limit, problems)
        with _named_problems(problems):
            if Kind.runs in wanted:
                tell_unfinished(list(unfinished_runs(registry)))
    for problem in dict.fromkeys(problems):
        warn(f"{problem}; see `torquebench records verify`")
    if problems:
        raise typer.Exit(CHECK_FAILED)


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
) -> None:
    """Show one record, and check its files against their hashes."""
    from torquebench.operations.records import find_run
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        named = numbered(name, "model", "calibration")
        if named is None:
            _show_run(find_run(registry, name))
            return
        kind, number = named
        (_show_model if kind == "model" else _show_calibration)(registry, number)


def _list_runs(registry: Registry, limit: int, problems: list[str]) -> None:
    _print_runs(registry.runs(limit=limit + 1, problems=problems), limit)


def _print_runs(runs: Sequence[RunLine | RunSummary], limit: int) -> None:
    lines = [
        (run.run_id, _moment(run.started), run.status, "simulated" if run.simulated else run.bench)
        for run in runs
    ]
    headings = ("run", "started (UTC)", "status", "bench")
    _print_list(Kind.runs, headings, lines, [LISTED_RUN.of(run) for run in runs], limit)


def _list_calibrations(registry: Registry, limit: int, problems: list[str]) -> None:
    lines, records = [], []
    for entry in registry.calibrations(limit=limit + 1, problems=problems):
        name, span = f"calibration-{entry.calibration_id}", f"{entry.range_nm:g} N·m"
        records.append(LISTED_CALIBRATION.of(entry, name=name))
        what = (entry.transducer_serial, str(entry.points), span, entry.profile_name)
        lines.append((name, _moment(entry.performed), *what))
    headings = ("name", "performed (UTC)", "transducer", "points", "range", "profile")
    _print_list(Kind.calibrations, headings, lines, records, limit)


def _list_models(registry: Registry, limit: int, problems: list[str]) -> None:
    lines, records = [], []
    for entry in registry.models(limit=limit + 1, problems=problems):
        name, span = f"model-{entry.model_id}", f"{entry.range_nm:g} N·m"
        records.append(LISTED_MODEL.of(entry, name=name, in_use=entry.active))
        what = (entry.kind, entry.transducer_serial, span, "yes" if entry.active else "")
        lines.append((name, _moment(entry.created), *what))
    headings = ("name", "created (UTC)", "kind", "transducer", "range", "in use")
    _print_list(Kind.models, headings, lines, records, limit)


def _list_equipment(registry: Registry, limit: int, _problems: list[str]) -> None:
    entries = registry.equipment()
    lines = [
        (
            entry.kind,
            entry.serial,
            f"{entry.manufacturer} {entry.model}".strip(),
            "" if entry.range_nm is None else f"{entry.range_nm:g} N·m",
        )
        for entry in entries
    ]
    headings = ("|kind", "serial", "what", "range")
    records = [LISTED_EQUIPMENT.of(entry) for entry in entries]
    _print_list(Kind.equipment, headings, lines, records, limit)


def _print_list(
    kind: Kind,
    headings: Sequence[str],
    lines: Sequence[tuple[str, ...]],
    records: list[dict[str, Any]],
    limit: int,
) -> None:
    """Print lines up to the limit, and add their records to the JSON answer."""
    none = not lines
    table = narrow_table(
        kind.capitalize(), columns=headings, caption="none yet" * none, headings=not none
    )
    for line in lines[:limit]:
        table.add_row(*line)
    out().print(table)
    answer(**{kind.value: records[:limit]})
    if len(lines) > limit:
        answer(more=[kind.value])
        say(f"There are more than these {limit}: --limit NUMBER, or --all")


_LISTS = {
    Kind.runs: _list_runs,
    Kind.calibrations: _list_calibrations,
    Kind.models: _list_models,
    Kind.equipment: _list_equipment,
}


MOST_LISTED = 10**9


def _show_run(run: RunSummary) -> None:
    from torquebench.records import RunFolder
    from torquebench.records.runs.time_check import times_of_run

    folder = RunFolder.open(run.folder)
    _facts(
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


def _show_model(registry: Registry, model_id: int) -> None:
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
    _facts(
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
    )
    for verification in registry.verifications(model_id):
        _show_verification(verification)
        answer(verifications=[verification])


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


def _show_verification(verification: VerificationEntry) -> None:
    """Print a verification's errors before and after compensation."""
    from torquebench.calibration import ErrorSummary
    from torquebench.campaign.fitting import model_title
    from torquebench.cli.tables import error_blocks

    marked = " - simulated" if verification.simulated else ""
    say(f"\n[bold]Verified {_moment(verification.performed)}{marked}[/bold]")
    if verification.run_id:
        say(f"run {verification.run_id}")
    models = verification.summary["models"]
    blocks = []
    for key, title in (
        ("against_standard", "single readings against the standard"),
        ("against_truth", "single readings against the true torque"),
        ("averaged", "averaged over the groups"),
    ):
        rows = [
            (model_title(model["name"]), ErrorSummary(**model[key]))
            for model in models
            if model[key] is not None
        ]
        blocks.append((title, rows))
    for part in error_blocks(blocks):
        out().print(part)


def _show_calibration(registry: Registry, calibration_id: int) -> None:
    from torquebench.records.signatures import how

    entry = registry.calibration(calibration_id)
    models = registry.models(calibration_id=calibration_id)
    reviews = registry.reviews("calibrations", calibration_id)
    amendments = registry.amendments("calibrations", calibration_id)
    certificates = registry.certificates(calibration_id)
    low, high = entry.valid_nm
    _facts(
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


def _facts(title: str, facts: Mapping[str, str], record: object) -> None:
    print_facts(title, facts.items())
    answer(name=title, facts={key: value for key, value in facts.items() if value})
    answer(record=record)


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
