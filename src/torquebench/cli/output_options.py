"""`--json` and `--quiet`, added to all commands in one place."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from torquebench.cli.reports import ReportOption, check_reports, present
from torquebench.cli.terminal.console import begin_output
from torquebench.operations.result import Result

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the results as one JSON object instead of tables.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print warnings and errors only.")]

RESULTS: dict[str, type[Result]] = {}
"""Type of the result of each command that isn't an operation, by the command's name."""
WITHOUT_RESULT = {
    "panel": "serves the panel until it is ended",
    "simulate": "serves simulated instruments until it is ended",
}
"""Commands without `--json`, and the reason."""
HELP_OPTIONS = ["-h", "--help"]
PLAIN_NAMES = {Path: "path", str: "str", float: "float", int: "int"}


def add_output_options(app: typer.Typer, path: str = "") -> None:
    """Add `--quiet` to every command below, and `--json` and `--report` to those with a result."""
    for info in app.registered_commands:
        assert info.callback is not None
        name = info.name or info.callback.__name__.replace("_", "-")
        if "quiet" not in inspect.signature(info.callback).parameters:  # only once
            info.callback = _with_options(info.callback, f"{path}{name}")
    for group in app.registered_groups:
        assert group.typer_instance is not None
        below = group.name or group.typer_instance.info.name
        add_output_options(group.typer_instance, f"{path}{below} ")


def _with_options(command: Callable[..., Any], path: str) -> Callable[..., Any]:
    @functools.wraps(command)
    def run(*, quiet: bool = False, json: bool = False, **given: Any) -> Any:
        begin_output(path, json=json, quiet=quiet)
        reports = None if own_report else given.pop("report", None)
        check_reports(reports)
        for name, kind in groups.items():
            given[name] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        result = command(**given)
        if isinstance(result, Result):
            present(result, reports)
        return result

    signature = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {
        name: each.annotation
        for name, each in signature.parameters.items()
        if is_dataclass(each.annotation)
    }
    own_report = "report" in signature.parameters
    parameters = [part for each in signature.parameters.values() for part in _options(each)]
    for each in parameters:
        kind, *options = get_args(each.annotation) or (None,)
        for option in options:
            option.metavar = option.metavar or _value_name(kind)
    kind = signature.return_annotation
    added: dict[str, tuple[Any, Any]] = {}
    if inspect.isclass(kind) and issubclass(kind, Result):
        RESULTS[path] = kind
        if kind.page is not Result.page and not own_report:
            added["report"] = (ReportOption, None)
        added["json"] = (JsonOption, False)
    added["quiet"] = (QuietOption, False)
    parameters += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (kind, default) in added.items()
    ]
    # Typer reads a command's options from this attribute, which typing doesn't know.
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def _options(parameter: inspect.Parameter) -> Iterator[inspect.Parameter]:
    """Yield a parameter as an option, or the fields of a dataclass as options."""
    if not is_dataclass(parameter.annotation):
        yield parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        return
    hints = get_type_hints(parameter.annotation, include_extras=True)
    for each in fields(parameter.annotation):
        yield inspect.Parameter(
            each.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if each.default is MISSING else each.default,
            annotation=hints[each.name],
        )


def _value_name(kind: Any) -> str | None:
    """Return the placeholder of a value in help; None means the library's default.

    An option for a list has one value, an option for a pair has two.
    """
    kinds = (*get_args(kind), kind)
    inner = [each for each in kinds if get_origin(each) in (list, tuple)]
    values = get_args(inner[0]) if inner else [each for each in kinds if each in (float, int)][:1]
    names = [PLAIN_NAMES.get(each) for each in values]
    return " ".join(f"<{name}>" for name in names) if names and all(names) else None


def leave_out_types_of_flags(command: Any) -> None:
    """Hide the type of flags in the help of a command and its subcommands."""
    asked = command.get_help_option(typer.Context(command, help_option_names=HELP_OPTIONS))
    for option in (*command.params, asked):
        if getattr(option, "is_flag", False):
            option.metavar = " "
    for below in getattr(command, "commands", {}).values():
        leave_out_types_of_flags(below)
