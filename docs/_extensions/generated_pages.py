"""Pages that are made from the program: commands, settings files, alarms, Python interface."""

import importlib
import inspect
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import date
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel
from sphinx.util import logging

from torquebench.cli.output_options import RESULTS, WITHOUT_RESULT
from torquebench.operations.result import ArrayOf

PYTHON = {
    "torquebench": "For notebooks and scripts: import torquebench as tb",
    "torquebench.compensation": "Models of a measuring chain's error, their files and exports",
    "torquebench.chain": "From a reading to torque, uncertainty and budget",
    "torquebench.calibration": "Calibration tables, profiles, evaluation, verification",
    "torquebench.reducers": "Evaluation of reducer tests",
    "torquebench.signals": "Edges, frequency, steady values, orders",
    "torquebench.uncertainty": "Propagation by GUM and Monte Carlo, budgets",
    "torquebench.mechanics": "Shafts, additional torque, sections",
    "torquebench.client": "A client of the HTTP API, sync and async",
    "torquebench.bench.drivers.base": "Interfaces that a driver implements",
    "torquebench.errors": "Errors",
    "torquebench.units": "Conversion factors",
}
SETTINGS = {
    "bench": (
        "Bench description (bench.toml)",
        "torquebench.bench.description",
        "BenchDescription",
    ),
    "profile": ("Calibration profile", "torquebench.calibration.profile", "Profile"),
    "reducer": ("Reducer description", "torquebench.reducers.description", "ReducerDescription"),
    "laboratory": (
        "Laboratory (laboratory.toml)",
        "torquebench.reports.certificate.laboratory",
        "Letterhead",
    ),
    "sparkplug": (
        "Sparkplug settings",
        "torquebench_sparkplug.settings",
        "SparkplugSettings",
    ),
}


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _commands() -> str:
    from torquebench.cli import whole_command

    root = whole_command()
    lines = [
        "# All commands and options",
        "",
        "Generated from the program. `torquebench COMMAND --help` shows the same in a terminal.",
        "[Commands](../reference/commands.md) is the short list.",
        "",
    ]

    def describe(command: Any, path: str, level: int) -> None:
        lines.extend([f"{'#' * level} `{path}`", "", inspect.cleandoc(command.help or ""), ""])
        arguments = [each for each in command.params if each.param_type_name == "argument"]
        options = [
            each for each in command.params if each.param_type_name == "option" and not each.hidden
        ]
        if arguments or options:
            lines.extend(["| option | default | description |", "| --- | --- | --- |"])
            lines.extend(
                f"| `{each.name.upper()}` | | {_cell(each.help or '')} |" for each in arguments
            )
            for each in options:
                if "--help" in each.opts:
                    continue
                names = " ".join(f"`{name}`" for name in (*each.opts, *each.secondary_opts))
                value = "" if each.default is None or callable(each.default) else each.default
                default = "" if value in ("", False, [], ()) else f"`{value}`"
                lines.append(f"| {names} | {default} | {_cell(each.help or '')} |")
            lines.append("")
        for name, child in sorted(getattr(command, "commands", {}).items()):
            describe(child, f"{path} {name}", min(level + 1, 4))

    for name, command in sorted(root.commands.items()):
        describe(command, f"torquebench {name}", 2)
    return "\n".join(lines)


def _operations() -> str:
    from torquebench.operations import OPERATIONS, Result, parameters

    lines = [
        "# Operations",
        "",
        "Generated from the program. The command line, the [HTTP API](../reference/http-api.md)",
        "and the panel have the same operations with the same fields and defaults. Results have,",
        "beside what is listed, " + ", ".join(f"`{each.name}`" for each in fields(Result)) + ".",
        "",
    ]
    for operation in OPERATIONS.values():
        lines += [f"## `{operation.name}`", "", operation.description, ""]
        needs = {"bench": "an open bench", "folder": "records"}.get(
            operation.where, operation.where
        )
        lines += [f"Needs {needs} and the role {operation.role}.", ""]
        lines += [f"Result: {_shape(operation.result)}.", ""]
        if fields_of_request := parameters(operation.request):
            lines += ["| field | default | unit, limits | description |"]
            lines += ["| --- | --- | --- | --- |"]
        for each in fields_of_request:
            limits = ", ".join(part for part in (each.unit, each.limits) if part)
            default = "" if each.default in (None, "", (), {}) or each.record else each.default
            if isinstance(default, tuple):
                default = ", ".join(map(str, default))
            if isinstance(default, bool):
                default = str(default).lower()
            stated = "required" if each.required else f"`{default}`" if default != "" else ""
            lines.append(f"| `{each.name}` | {stated} | {limits} | {_cell(each.help)} |")
        lines.append("")
    for result, kinds in _results(each.result for each in OPERATIONS.values()).items():
        lines += ["", f"({_anchor(result)})=", f"## {result.__name__}", ""]
        lines += [(inspect.getdoc(result) or "").split("\n")[0], ""]
        lines += ["| key | value |", "| --- | --- |"] if kinds else []
        lines += [f"| `{key}` | {_shape(kind)} |" for key, kind in kinds.items()]
    return "\n".join(lines) + "\n"


def _results(kinds: Iterable[Any]) -> dict[Any, dict[str, Any]]:
    """Return results and the dataclasses in them, with their keys' kinds."""
    from torquebench.operations import Result

    common = {each.name for each in fields(Result)}
    waiting: list[Any] = list(kinds)
    results: dict[Any, dict[str, Any]] = {}
    for result in waiting:  # grows by the dataclasses inside
        if result in results:
            continue
        hints = get_type_hints(result, include_extras=True)
        results[result] = {
            each.name: hints[each.name]
            for each in fields(result)
            if not each.metadata.get("hidden")
            and not (issubclass(result, Result) and each.name in common)
        }
        waiting += [each for kind in results[result].values() for each in _inside(kind)]
    return results


def _answers() -> str:
    from torquebench.cli import whole_command
    from torquebench.cli.measure import MeasuredInterval
    from torquebench.operations import OPERATIONS, Result

    lines = [
        "# Answers in JSON",
        "",
        "Generated from the program. With `--json` a command prints one JSON object on one line:",
        "",
        "| key | value |",
        "| --- | --- |",
        "| `torquebench` | version |",
        "| `command` | the command, such as `records list` |",
        "| `exit_code` | one of the [exit codes](../reference/commands.md#exit-codes) |",
        "| `answer` | the table below; empty after an error |",
        "| `warnings` | list of text |",
        "| `error` | null, or `found`, `allowed` and `do` |",
        "",
        "Names end with their unit. `null`: not known, or there is none. Times are",
        "ISO 8601. Every answer has "
        + ", ".join(f"`{each.name}`" for each in fields(Result))
        + ";",
        "those of [operations](operations.md) are listed there. `measure` prints a line of its own",
        "for each interval before, with `line` in the place of `answer`.",
        "",
    ]
    whole_command()  # loads all commands
    lines += [f"`{name}` has no `--json`: it {why}." for name, why in WITHOUT_RESULT.items()]
    names: dict[Any, list[str]] = {}
    for command, kind in RESULTS.items():
        names.setdefault(kind, []).append(f"`{command}`")
    listed = _results(each.result for each in OPERATIONS.values())
    for result, kinds in _results([*names, MeasuredInterval]).items():
        if result in listed:
            continue
        about = (inspect.getdoc(result) or "").split("\n")[0]
        heading = ": ".join(each for each in (", ".join(names.get(result, ())), about) if each)
        lines += ["", f"({_anchor(result)})=", f"## {heading.rstrip('.')}", ""]
        lines += ["| key | value |", "| --- | --- |"] if kinds else []
        lines += [f"| `{key}` | {_shape(kind)} |" for key, kind in kinds.items()]
    return "\n".join(lines) + "\n"


def _anchor(part: Any) -> str:
    about = f"{part.__module__} {part.__name__}"
    return "answer-" + re.sub(r"\W+", "-", about.lower()).strip("-")


def _inside(kind: Any) -> Iterator[Any]:
    """Yield the dataclasses that a kind is made of."""
    if is_dataclass(kind):
        yield kind
    if get_origin(kind) is Literal:
        return
    below = get_args(kind)
    for each in below[:1] if get_origin(kind) is Annotated else below:
        yield from _inside(each)


def _shape(kind: Any) -> str:
    if is_dataclass(kind):
        return f"[{kind.__name__}](#{_anchor(kind)})"
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:  # numbers of any kind of sequence, by their schema
        arrays = (each.kind for each in parts[1:] if isinstance(each, ArrayOf))
        return next((f"list of {kind}" for kind in arrays), _shape(parts[0]))
    if origin in (list, tuple, Sequence):
        return f"list of {_shape(parts[0])}"
    if origin in (dict, Mapping):
        return f"object of {_shape(parts[1])}"
    if origin is np.ndarray:
        return "list of number"
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_shape(each) for each in parts))
    if origin is Literal or (inspect.isclass(kind) and issubclass(kind, str | date | Path)):
        return "text"
    names = {float: "number", int: "integer", bool: "true or false", NoneType: "null"}
    return names.get(kind, "value")


def _bounds(field: Any) -> str:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = []
    for each in field.metadata:
        for key, sign in signs.items():
            if getattr(each, key, None) is not None:
                found.append(f"{sign} {getattr(each, key):g}")
    return ", ".join(found)


def _type(annotation: Any, file: str) -> str:
    if hasattr(annotation, "__metadata__"):
        return _type(get_args(annotation)[0], file)
    origin = get_origin(annotation)
    if origin is Literal:
        return ", ".join(
            f'`"{each}"`' if isinstance(each, str) else f"`{each}`" for each in get_args(annotation)
        )
    if origin in (Union, UnionType):
        return " or ".join(
            _type(each, file) for each in get_args(annotation) if each is not type(None)
        )
    if origin in (tuple, list):
        return f"list of {_type(get_args(annotation)[0], file)}"
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return f"[table](#{file}-{annotation.__name__})"
    names = {str: "text", float: "number", int: "integer", bool: "true or false", Path: "path"}
    return names.get(annotation, getattr(annotation, "__name__", "table"))


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if (
        inspect.isclass(annotation)
        and get_origin(annotation) is None
        and issubclass(annotation, BaseModel)
    ):
        yield annotation
    for each in get_args(annotation):
        yield from _models(each)


def _tables(model: type[BaseModel]) -> dict[type[BaseModel], list[str]]:
    """Return every table of a file with the places where it may stand, outermost first."""
    places: dict[type[BaseModel], list[str]] = {}
    waiting = [(model, "")]
    while waiting:
        current, path = waiting.pop(0)
        places.setdefault(current, []).append(path)
        for key, field in current.model_fields.items():
            for child in _models(field.annotation):
                many = "list" if get_origin(field.annotation) in (tuple, list) else ""
                name = f"{path}.{key}" if path else key
                waiting.append((child, f"[{name}]" if many else name))
    return places


def _heading(paths: list[str]) -> str:
    return ", ".join(f"`[{path}]`" for path in paths) if paths != [""] else "Whole file"


def _settings(title: str, module: str, name: str) -> str:
    places = _tables(getattr(importlib.import_module(module), name))
    lines = [
        f"# {title}",
        "",
        "Generated from the program, which refuses keys that aren't listed.",
        "",
    ]
    for model, paths in places.items():
        text = inspect.cleandoc(model.__doc__ or "").split("\nAttributes\n")[0]
        lines.extend([f"({name}-{model.__name__})=", f"## {_heading(paths)}", "", text, ""])
        lines.extend(["| key | value | unit, bounds | default |", "| --- | --- | --- | --- |"])
        for key, field in model.model_fields.items():
            unit = ", ".join(each for each in (field.description or "", _bounds(field)) if each)
            if field.is_required():
                default = "required"
            else:
                value = field.get_default(call_default_factory=True)
                plain = value is None or isinstance(value, BaseModel) or value in ((), "", {})
                default = (
                    "" if plain else f"`{str(value).lower() if isinstance(value, bool) else value}`"
                )
            kind = _type(field.annotation, name)
            lines.append(f"| `{field.alias or key}` | {kind} | {_cell(unit)} | {default} |")
        lines.append("")
    return "\n".join(lines)


def _alarms() -> str:
    from torquebench.bench.safety.alarms import ALARM_CATALOGUE

    lines = [
        "# Alarms",
        "",
        "Every alarm names its source, the value found, the limit and what to do. A critical alarm",
        "brings the bench to its [safe state](../explanation/safety.md) and latches until somebody",
        "acknowledges it.",
        "",
        "| alarm | cause | what to do |",
        "| --- | --- | --- |",
    ]
    lines += [
        f"| {kind.value} | {entry.cause} | {entry.remedy} |"
        for kind, entry in ALARM_CATALOGUE.items()
    ]
    return "\n".join(lines)


def _python(module: str, title: str) -> str:
    loaded = importlib.import_module(module)
    public = (each for each in loaded.__all__ if not each.startswith("_"))
    names = [each for each in public if getattr(getattr(loaded, each), "__doc__", None)]
    lines = [f"# {module}", "", f"{title}.", "", "```{eval-rst}", f".. module:: {module}", ""]
    others = [each for each in PYTHON if not module.startswith(each)]
    for name in sorted(names):
        thing = getattr(loaded, name)
        kind = (
            "autoclass"
            if inspect.isclass(thing)
            else "autofunction"
            if callable(thing)
            else "autodata"
        )
        lines += [f".. {kind}:: {module}.{name}"]
        if getattr(thing, "__module__", module).startswith(tuple(f"{each}." for each in others)):
            lines += ["   :no-index:"]  # it stands on its own package's page, too
        lines += [""]
    return "\n".join([*lines, "```"])


def _pages_of_plugins() -> dict[str, str]:
    """Return the pages beside the plugins' sources; their links into `docs` stay right."""
    root = Path(__file__).parents[2]
    return {
        f"plugins/{page.stem}": page.read_text(encoding="utf-8").replace(
            "](../../../docs/", "](../../"
        )
        for page in sorted(root.glob("plugins/*/docs/*.md"))
    }


def write_pages(folder: Path) -> list[Path]:
    """Write every generated page; one that hasn't changed keeps its date."""
    pages = {"commands": _commands(), "operations": _operations()}
    pages |= {"answers": _answers(), "alarms": _alarms()}
    pages |= {f"{key}-file": _settings(*value) for key, value in SETTINGS.items()}
    pages |= {f"python/{module}": _python(module, title) for module, title in PYTHON.items()}
    pages |= _pages_of_plugins()
    listed = "\n".join(f"{module}" for module in PYTHON)
    pages["python/index"] = (
        "# Python interface\n\nWhat is listed here is the documented interface.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    )
    written = []
    for name, text in pages.items():
        path = folder / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def _nothing_from_elsewhere(app: Any, failure: Exception | None) -> None:
    """Warn of scripts, styles and pictures that a page would load from another host."""
    if failure is not None or app.builder.format != "html":
        return
    loads = re.compile(
        r"""<(?:script|img|iframe)[^>]*\ssrc="https?:|<link[^>]*stylesheet[^>]*href="https?:"""
    )
    for page in Path(app.outdir).rglob("*.html"):
        if loads.search(page.read_text(encoding="utf-8")):
            logging.getLogger(__name__).warning("%s loads files from another host", page.name)


def setup(app: Any) -> dict[str, bool]:
    """Write the pages before Sphinx looks for its sources."""
    write_pages(Path(app.srcdir) / "generated")
    app.connect("build-finished", _nothing_from_elsewhere)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
