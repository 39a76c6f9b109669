"""`torquebench evaluate hysteresis|friction|…`: reducer tests of other benches.

A command for each evaluation of the catalogue: its fields are the options.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from torquebench.cli.options import tell_columns
from torquebench.cli.reducers.columns import read_columns
from torquebench.cli.reducers.tables import present
from torquebench.cli.reports import ReportOption, check_reports, write_reports
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.campaign.reducers.evaluations import TableEvaluation

TABLE = "A table with a header (CSV, Excel, TDMS, …)"
FileArgument = Annotated[Path, typer.Argument(help=f"{TABLE}.")]
FilesArgument = Annotated[
    list[Path],
    typer.Argument(
        help=f"{TABLE}, or several. A torque or speed may stand in a comment or in the file's "
        "name, as `300rpm`."
    ),
]
ReducerOption = Annotated[
    str | None,
    typer.Option("--reducer", help="Its description: a .toml file, or a packaged type's name."),
]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        help="Assigns a header to a quantity: NAME=Header[unit]; a minus sign before the header "
        "reverses the sign. May be repeated.",
    ),
]
WhereOption = Annotated[
    list[str] | None,
    typer.Option("--where", help="Use only rows with Header=value,value. May be repeated."),
]
OutputOption = Annotated[
    Path | None, typer.Option("--output", help="A folder for every number and the curves.")
]


def evaluation_command(kind: type[TableEvaluation]) -> Callable[..., None]:
    """Return the command of an evaluation."""

    def command(
        data: Any,
        reducer: ReducerOption = None,
        column: ColumnOption = None,
        where: WhereOption = None,
        output: OutputOption = None,
        report: ReportOption = None,
        **options: Any,
    ) -> None:
        check_reports(report)
        files = data if kind.several else [data]
        _evaluate(kind(**options), files, reducer, column, where, output, report)

    signature = inspect.signature(command, eval_str=True)
    named = dict(signature.parameters)
    del named["options"]
    files = FilesArgument if kind.several else FileArgument
    named["data"] = named["data"].replace(annotation=files)
    if not kind.described:
        del named["reducer"]
    hints = get_type_hints(kind, include_extras=True)
    named |= {each.name: _parameter(each, hints[each.name]) for each in fields(kind)}
    for last in ("output", "report"):
        named[last] = named.pop(last)
    ordered = sorted(named.values(), key=lambda each: each.default is not each.empty)
    parameters = [each.replace(kind=each.KEYWORD_ONLY) for each in ordered]
    # Typer reads a command's options from this attribute, which typing doesn't know.
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__doc__ = kind.__doc__
    return command


def _parameter(field: Field[Any], hint: Any) -> inspect.Parameter:
    """Return a field of an evaluation as an option of its command."""
    kind, option = get_args(hint)
    flags = [f"--{field.name.replace('_', '-')}"] if kind is bool else []
    shown = typer.Option(*flags, help=option.about, min=option.least, max=option.most)
    return inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if field.default is MISSING else field.default,
        annotation=Annotated[kind, shown],
    )


def _evaluate(
    evaluation: TableEvaluation,
    files: list[Path],
    named: str | None,
    column: list[str] | None,
    where: list[str] | None,
    output: Path | None,
    report: list[Path] | None,
) -> None:
    reducer = None
    if named is not None:
        from torquebench.reducers import load_reducer

        reducer = load_reducer(named)
    evaluation.check(reducer)
    needed = evaluation.required()
    read = read_columns(files, evaluation.columns, needed, column or (), where or ())
    tell_columns(read.understood, read.notes)
    table = {**read.numbers, "row": read.rows.astype("float64")}
    source = ", ".join(file.name for file in files)

    from torquebench.reducers import OpenLoopError, verdicts

    try:
        result, settings = evaluation.evaluate(table, reducer)
    except OpenLoopError as problem:
        if report:
            from torquebench.reports.evaluation_report import open_loop_page

            write_reports(open_loop_page(source, problem.loop, str(problem)), report)
            raise
        remedy = Message("{remedy}; --report draws the gap", problem.remedy)
        raise InputError(problem.found, problem.allowed, remedy) from None
    except InputError as problem:
        if not evaluation.keep_outliers:
            raise
        remedy = Message("{remedy}; or leave --keep-outliers out", problem.remedy)
        raise InputError(problem.found, problem.allowed, remedy) from None
    options = asdict(evaluation)
    title = evaluation.title.format_map(options)
    judged = () if reducer is None else verdicts(result, reducer)
    if report:
        from torquebench.reports.evaluation_report import evaluation_page

        figures = evaluation.figures(result)
        write_reports(evaluation_page(title, source, result, judged, reducer, figures), report)
    described = None if reducer is None else reducer.model_dump(mode="json")
    present(title, files, result, judged, output, {**options, **settings, "reducer": described})
