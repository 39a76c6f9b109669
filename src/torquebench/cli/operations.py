"""Commands of operations: options derived from the request, and a common procedure."""

from __future__ import annotations

import contextlib
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    RealTimeOption,
    YesOption,
    bench_description,
    check_output,
    check_output_folder,
    named_values,
)
from torquebench.cli.output_options import JsonOption, QuietOption
from torquebench.cli.reports import ReportOption, check_reports, present, write_reports
from torquebench.cli.terminal.console import (
    answer,
    begin_output,
    stderr_console,
    warn,
)
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.operations import Operation, Parameter, parameters
from torquebench.operations.place import (
    REGISTRY_FILE,
    PackagedLibrary,
    data_directory,
    has_registry,
)

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.cli.bench_session import BenchSession
    from torquebench.operations import Place, Request, Result
    from torquebench.progress import Progress

TYPES: Mapping[str, Any] = {"number": float, "whole": int}
NOT = "not_"
"""Prefix of the name of a flag that sets False."""
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Show what would happen and check it; nothing moves.")
]
ByOption = Annotated[
    str | None,
    typer.Option(
        "--by", metavar="NAME", help="Who does it; by default the person at this account."
    ),
]


# -- options --------------------------------------------------------------------------------


def operation_command(operation: Operation) -> Callable[..., None]:
    """Return the command of an operation, for Typer."""
    asked = {each.name: each for each in parameters(operation.request)}

    def command(**given: Any) -> None:
        values = {name: given.pop(name, None) for name in asked}
        values |= {name: False for name in asked if given.pop(f"{NOT}{name}", False)}
        json = given.pop("json")
        begin_output(operation.name, json=json, quiet=given.pop("quiet"))
        if operation.asks and not json and sys.stdin.isatty():
            values |= _asked(asked.values(), values)
        _run(operation, _entered(asked, values), **given)

    options = [part for each in asked.values() for part in _options(each)]
    options += _common(operation)
    options.sort(key=lambda each: each.default is not inspect.Parameter.empty)
    # Typer reads a command's options from this attribute, which typing doesn't know.
    command.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in options}
    command.__doc__ = operation.description
    return command


def _common(operation: Operation) -> Iterator[inspect.Parameter]:
    """Yield the options that are common to operations."""
    from torquebench.operations import Result

    if operation.preview is not None:
        yield _parameter("dry_run", DryRunOption, False)
    if operation.result.page is not Result.page:
        yield _parameter("report", ReportOption, None)
    if operation.where == "bench":
        yield _parameter("bench", BenchOption, None)
    if operation.where != "files":
        yield _parameter("data", DataOption, DEFAULT_DATA)
    if operation.role != "operator" or operation.signed:
        yield _parameter("by", ByOption, None)
    if operation.where == "bench":
        yield _parameter("yes", YesOption, False)
        yield _parameter("real_time", RealTimeOption, False)
    yield _parameter("json", JsonOption, False)
    yield _parameter("quiet", QuietOption, False)


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _options(asked: Parameter) -> Iterator[inspect.Parameter]:
    """Yield a request's field as an option; for a flag, only options that change the default."""
    if asked.kind != "flag":
        yield _option(asked)
        return
    if asked.default is not True:
        yield _parameter(
            asked.name, Annotated[bool, typer.Option(asked.option, help=asked.help)], None
        )
    if asked.default is not False:
        first = f"{asked.help[:1].lower()}{asked.help[1:]}".partition(". ")[0].removesuffix(".")
        made = typer.Option(f"--no-{asked.option[2:]}", help=f"Don't {first}.")
        yield _parameter(f"{NOT}{asked.name}", Annotated[bool, made], False)


def _option(asked: Parameter) -> inspect.Parameter:
    """Return a field other than a flag as an option, whose value the request validates."""
    kind: Any = str if asked.numbered else TYPES.get(asked.kind, str)
    metavar = {
        "number": "<float>",
        "whole": "<int>",
        "text": "<str>",
        "path": "<path>",
        "day": "<day>",
    }.get(asked.kind)
    words = asked.help
    stated = re.search(rf"(?<!\w){re.escape(asked.unit)}(?!\w)", words)
    unit = "" if stated else asked.unit.strip()  # a blank says that there is none
    if asked.kind == "choice":
        metavar = f"<{'|'.join(asked.choices)}>"
        if asked.argument:
            words = f"{words.removesuffix('.')}: {', '.join(asked.choices)}."
    elif asked.numbered:
        metavar = f"{asked.numbered}-N"
    elif asked.kind in ("record", "values"):
        metavar = "NAME=VALUE"
        words += " May be repeated"
        words += f": {', '.join(asked.record.model_fields)}." if asked.record else "."
    elif asked.limits or unit:
        words = f"{words.removesuffix('.')} ({f'{asked.limits} {unit}'.strip()})."
    several = asked.several or asked.kind in ("record", "values")
    if asked.pair:
        kind, metavar = tuple[kind, kind], f"{metavar} {metavar}"
    default: Any = asked.default
    if asked.kind in ("record", "values"):
        default = None
    elif several and default is not None:
        default = list(default)
    kind = list[kind] if several else kind
    if asked.required:
        default = inspect.Parameter.empty
    elif default is None:
        kind |= None
    details: dict[str, Any] = {"help": words, "metavar": metavar}
    if asked.choices:
        details["autocompletion"] = lambda: list(asked.choices)
    if asked.argument:
        made = typer.Argument(**details | {"metavar": asked.option[2:].upper()})
    else:
        made = typer.Option(asked.option, **details)
    return _parameter(asked.name, Annotated[kind, made], default)


def _entered(asked: Mapping[str, Parameter], values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the entered values to the form that the request expects."""
    entered: dict[str, Any] = {}
    for name, value in values.items():
        parameter = asked[name]
        if value is None or (parameter.several and not value and not parameter.required):
            continue
        if parameter.kind in ("record", "values"):
            if not value:
                continue
            value = named_values(value, parameter.option, "name=value")
        entered[name] = value
    return entered


def _asked(fields: Iterable[Parameter], values: Mapping[str, Any]) -> dict[str, Any]:
    """Ask for basic values that have their defaults; Enter takes the default."""
    from rich.prompt import Prompt

    console, answers = stderr_console(), dict[str, Any]()
    for each in fields:
        if each.expert or each.required or values[each.name] != each.default:
            continue
        for choice in each.choices if each.titles else ():
            console.print(f"  {choice:<10} {each.titles[choice]}", markup=False)
        answers[each.name] = Prompt.ask(
            each.help.removesuffix("."),
            console=console,
            choices=list(each.choices) or None,
            show_choices=not each.titles,
            default=each.default,
        )
    return answers


# -- work -----------------------------------------------------------------------------------


def validated_request(operation: Operation, values: Mapping[str, Any]) -> Request:
    """Validate a request, and check that named profiles and reducers exist."""
    from torquebench.validation import validated

    request = validated(operation.request, values, operation.name)
    library = PackagedLibrary()
    read: list[Path] = []
    written: list[tuple[Path, tuple[str, ...]]] = []
    for each in parameters(operation.request):
        name = getattr(request, each.name)
        if each.kind == "path" and not each.output and name is not None:
            read += _listed(name)
        if name is not None and "folder" in each.output and name.suffix not in each.output:
            check_output_folder(name)
        elif name is not None and each.output:
            written += [(part, each.output) for part in _listed(name)]
        kind = each.names.partition(":")[0]
        if kind in ("profiles", "reducers") and name is not None:
            (library.profile if kind == "profiles" else library.reducer)(name)
    for path, endings in written:
        check_output(path, *read, endings=endings)
    return request


def _listed(paths: Path | tuple[Path, ...]) -> tuple[Path, ...]:
    return (paths,) if isinstance(paths, Path) else paths


def _run(
    operation: Operation,
    values: Mapping[str, Any],
    *,
    report: list[Path] | None = None,
    dry_run: bool = False,
    bench: Path | None = None,
    data: Path = DEFAULT_DATA,
    by: str | None = None,
    yes: bool = False,
    real_time: bool = False,
) -> None:
    request = validated_request(operation, values)
    check_reports(report)
    if operation.where == "bench":
        description, resumed = _description(operation, request, bench, data)
        if dry_run:
            _rehearse(operation, request, description, data)
            return
        _refuse_unattended(operation, description, yes=yes)
        with opened_bench(
            description, data, real_time=real_time, yes=yes, resumed=resumed
        ) as session:
            result = run_on_bench(session, operation, request)
    else:
        with _records_place(operation, data, by or "") as place:
            tell_doubts(_doubts(operation, place, request))
            try:
                with _working() as progress:
                    result = operation.run(place, request, progress)
            except BaseException as problem:
                tell_doubts(place.remarks)
                if isinstance(problem, InputError):
                    raise _explained(problem, report) from None
                raise
    present(result, report)


def _explained(problem: InputError, reports: list[Path] | None) -> InputError:
    """Write the page that explains an error, or add to the remedy how to get it."""
    from torquebench.operations.result import ExplainedError

    if not isinstance(problem, ExplainedError):
        return problem
    if reports:
        write_reports(problem.page(), reports)
        return problem
    remedy = Message("{remedy}; --report draws the reason", problem.remedy)
    return InputError(problem.found, problem.allowed, remedy)


def _description(
    operation: Operation, request: Request, bench: Path | None, data: Path
) -> tuple[BenchDescription, str]:
    """Return the description of the bench, and the run to be resumed on it.

    The description is the command's, the resumed run's, or the simulated bench's.
    """
    if operation.bench is None:
        return bench_description(bench), ""
    from torquebench.campaign.resuming import find_interrupted
    from torquebench.records import Registry
    from torquebench.station import recover_unfinished
    from torquebench.station.bench_lock import BenchLock

    folder = data_directory(data)
    with BenchLock(None, folder), Registry.open(folder) as registry:
        recover_unfinished(registry)  # a killed run has to be sealed first
        run = find_interrupted(registry, getattr(request, "run_id", ""))
        described = (
            operation.bench(registry, request) if bench is None else bench_description(bench)
        )
        return described, run.run_id


def _rehearse(
    operation: Operation, request: Request, description: BenchDescription, data: Path
) -> None:
    """Print the preview of the plan that would run with the present records."""
    import dataclasses

    from torquebench.cli.bench_session import rehearsing
    from torquebench.cli.terminal.page import print_page
    from torquebench.operations import Place
    from torquebench.records import Registry
    from torquebench.records.signatures import operator_name

    assert operation.preview is not None
    with contextlib.ExitStack() as opened:
        station = opened.enter_context(rehearsing(description))
        registry = station.registry
        if has_registry(data):
            registry = opened.enter_context(Registry.open(data))
        place = Place(operator_name(), PackagedLibrary(), registry, station)
        doubts = _doubts(operation, place, request)
        preview = operation.preview(place, request)
        preview = dataclasses.replace(preview, doubts=doubts, simulated=description.simulated)
    print_page(preview.page())
    tell_doubts(preview.doubts)
    answer(**vars(preview))


def _refuse_unattended(operation: Operation, description: BenchDescription, *, yes: bool) -> None:
    """Refuse to load a real bench if nobody can confirm it, before the bench is opened."""
    if operation.loads and not (yes or description.simulated or sys.stdin.isatty()):
        raise InputError(
            Message("{name} is a real bench and nobody is there to confirm", description.name),
            "a person at the terminal, or --yes",
            "check that nobody is at the bench, then give --yes",
        )


@contextlib.contextmanager
def opened_bench(
    description: BenchDescription, data: Path, *, real_time: bool, yes: bool, resumed: str = ""
) -> Iterator[BenchSession]:
    """Open the bench for operations that a person at the terminal watches; see `open_bench`."""
    from torquebench.cli.bench_session import open_bench

    with open_bench(description, data, real_time=real_time, yes=yes, resumed=resumed) as session:
        yield session


def run_on_bench(session: BenchSession, operation: Operation, request: Request) -> Result:
    """Check an operation, ask for confirmation, and run it on an open bench."""
    import dataclasses

    from torquebench.operations import Place
    from torquebench.records.signatures import operator_name

    station = session.station
    place = Place(operator_name(), PackagedLibrary(), station.registry, station)
    tell_doubts(_doubts(operation, place, request))
    if operation.loads and not (session.yes or station.description.simulated):
        _confirm(place, operation, request)
    finishing = place.finishing if operation.can_finish else None
    with session.measuring(may_pause=operation.can_pause, finishing=finishing) as (
        progress,
        interrupts,
    ):
        place = dataclasses.replace(
            place, on_pause=interrupts.ask, cancelled=lambda: interrupts.abort_reason
        )
        return operation.run(place, request, progress)


def _confirm(place: Place, operation: Operation, request: Request) -> None:
    """Ask a person to confirm that a real bench is clear."""
    from torquebench.operations import duration_words

    words = str(operation.title(request))
    if operation.preview is not None:
        preview = operation.preview(place, request)
        words += f": {preview.points} points, {duration_words(preview.duration_s)}"
        for unit, largest in (
            ("N·m", preview.largest_torque_nm),
            ("rpm", preview.largest_speed_rpm),
        ):
            words += "".join(f", {side} up to {x:.4g} {unit}" for side, x in largest.items() if x)
    stderr_console().print(f"{place.station.description.name}. {words}.", markup=False)
    if not typer.confirm("Is the bench clear, and may it start?", err=True):
        raise typer.Exit(1)


@contextlib.contextmanager
def _records_place(operation: Operation, data: Path, by: str) -> Iterator[Place]:
    """Open the registry or nothing, as an operation without a bench needs it."""
    from torquebench.operations import Place
    from torquebench.records.signatures import operator_name

    who = by.strip() or operator_name()
    if operation.where in ("folder", "files"):
        yield Place(who, PackagedLibrary(), folder=data)
        return
    from torquebench.records import Registry

    folder = data if operation.begins else data_directory(data)
    with contextlib.ExitStack() as opened:
        if operation.begins and not has_registry(folder):
            opened.enter_context(_withdrawn(folder))
        if not operation.exclusive:
            registry = opened.enter_context(Registry.open(folder))
        else:
            from torquebench.station import recover_unfinished
            from torquebench.station.bench_lock import BenchLock

            opened.enter_context(BenchLock(None, folder))
            registry = opened.enter_context(Registry.open(folder))
            recover_unfinished(registry)
        yield Place(who, PackagedLibrary(), registry)


@contextlib.contextmanager
def _withdrawn(folder: Path) -> Iterator[None]:
    """Remove a new registry after a refusal, and its folder if that is new, too."""
    known = folder.is_dir()
    try:
        yield
    except InputError:
        for file in folder.glob(f"{REGISTRY_FILE}*"):
            file.unlink()
        if not known:
            with contextlib.suppress(OSError):  # another process may use it meanwhile
                folder.rmdir()
        raise


@contextlib.contextmanager
def _working() -> Iterator[Progress]:
    from torquebench.cli.terminal.progress import TerminalProgress

    with TerminalProgress() as progress:
        yield progress


def _doubts(operation: Operation, place: Place, request: Request) -> tuple[str, ...]:
    """Check a request; a missing record counts as unusable input."""
    try:
        return operation.doubts(place, request)
    except RecordError as missing:
        raise InputError(missing.found, missing.allowed, missing.remedy) from missing


def tell_doubts(doubts: Iterable[str]) -> None:
    """Print doubts about a result as warnings."""
    for doubt in doubts:
        warn(doubt)
