"""Output of all commands: results, messages, and results as JSON.

Results go to standard output, everything else to standard error. With `--json` a command prints
one JSON object instead of its tables; with `--quiet` it prints warnings and errors only.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message

if TYPE_CHECKING:
    pass

PLAIN_WIDTH = 80
"""Width of output to pipes, files and logs."""


@dataclass
class _Output:
    """Output settings of a command, and its JSON answer so far."""

    command: str = ""
    json: bool = False
    quiet: bool = False
    standard_output_is_a_file: bool = False
    written: set[Path] = field(default_factory=set)
    answer: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    error: dict[str, str] | None = None


_output = _Output()


def begin_output(command: str, *, json: bool, quiet: bool) -> None:
    """Set the output of the command that begins."""
    global _output
    _output = _Output(command, json, quiet)


def is_json() -> bool:
    """Return whether the command prints its results as JSON."""
    return _output.json


def is_quiet() -> bool:
    """Return whether the command prints only warnings and errors."""
    return _output.quiet


def answer(**facts: Any) -> None:
    """Add facts to the JSON answer.

    A list extends an earlier list of the same name.
    """
    for name, value in facts.items():
        before = _output.answer.get(name)
        if isinstance(before, list) and isinstance(value, list):
            value = before + value
        _output.answer[name] = value


def answer_line(**facts: Any) -> None:
    """Print one JSON object now, for a command that answers line by line."""
    _print_json({"command": _output.command, "line": facts})


def end_output(exit_code: int) -> None:
    """With `--json`, print the command's answer as one JSON object and reset the settings."""
    if _output.json:
        _print_answer(exit_code)
    begin_output("", json=False, quiet=False)


def _print_answer(exit_code: int) -> None:
    from torquebench import __version__

    _print_json(
        {
            "torquebench": __version__,
            "command": _output.command,
            "exit_code": exit_code,
            "answer": _output.answer,
            "warnings": _output.warnings,
            "error": _output.error,
        }
    )


def _print_json(content: Mapping[str, Any]) -> None:
    from torquebench.records.files import json_text

    sys.stdout.write(json_text(content) + "\n")
    sys.stdout.flush()


def leave_standard_output() -> None:
    """Print results to standard error, because a file is written to standard output.

    Raises
    ------
    InputError
        Where `--json` or another file also uses standard output.
    """
    if _output.json:
        raise InputError(
            "a file and --json for standard output", "one of both", "name a file with --out"
        )
    if _output.standard_output_is_a_file:
        raise InputError(
            "two files for standard output", "one", "name another file for one of them"
        )
    _output.standard_output_is_a_file = True


def claim_file(path: Path) -> None:
    """Register an output file of the command, so that it isn't written twice.

    Raises
    ------
    InputError
        Where the command already writes this file.
    """
    target = path.resolve()
    if target in _output.written:
        raise InputError(
            Message("{path} twice", path),
            "two different files",
            "name another file for one of them",
        )
    _output.written.add(target)


def out() -> Console:
    """Return the console for results (standard output), without styles outside a terminal."""
    silent = _output.json or _output.quiet
    return _console(stderr=_output.standard_output_is_a_file, quiet=silent)


def stderr_console() -> Console:
    """Return the console for messages and errors (standard error)."""
    return _console(stderr=True)


def _console(*, stderr: bool, quiet: bool = False) -> Console:
    console = Console(stderr=stderr, quiet=quiet, highlight=False, emoji=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = PLAIN_WIDTH
    return console


def say(text: str) -> None:
    """Print one line of results; text from outside must be escaped, because Rich markup applies."""
    out().print(text)


def say_file(title: str, path: object) -> None:
    """Print where a file was written, and add it to the answer's `files`."""
    print_file(title, path)
    answer(files=[str(path)])


def print_file(title: str, path: object) -> None:
    """Print where a file was written."""
    shown = "standard output" if str(path) == "-" else path
    named = f"{title}: {shown}" if title else str(shown)
    out().print(named, markup=False, soft_wrap=not title)


def note(text: str) -> None:
    """Print a line about the work itself to standard error, apart from the results."""
    if not _output.quiet:
        stderr_console().print(Text(text, style="dim"))


def warn(text: str) -> None:
    """Print a warning to standard error."""
    _output.warnings.append(text)
    stderr_console().print(f"[yellow]warning[/yellow]  {escape(text)}")


def write_error(error: TorquebenchError) -> None:
    """Print found, allowed and remedy of an error, one line each."""
    _output.error = {"found": error.found, "allowed": error.allowed, "do": error.remedy}
    _write_message({"error": error.found, "allowed": error.allowed, "do": error.remedy})


def _write_message(parts: Mapping[str, str]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, said in parts.items():
        style = "bold red" if name in ("error", "contradiction") else "dim"
        if said:
            table.add_row(Text(name, style=style), Text(said))
    stderr_console().print(table)


def narrow_table(
    title: str = "", *, columns: Sequence[str] = (), caption: str = "", headings: bool = True
) -> Table:
    """Return an empty table for at most 80 columns, with thin rules and one space of padding.

    Parameters
    ----------
    title : str
    columns : sequence of str
        Headings; a prefix ">" aligns the column right, and "|" (after ">", if any) forbids
        wrapping.
    caption : str
    headings : bool
        Whether headings are printed.
    """
    table = Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        caption=caption or None,
        caption_justify="left",
        caption_style="dim",
        box=None,
        padding=(0, 1, 0, 0),
        header_style="bold",
        pad_edge=False,
        show_header=headings,
    )
    for column in columns:
        heading = column.removeprefix(">")
        table.add_column(
            heading.removeprefix("|"),
            justify="right" if column.startswith(">") else "left",
            no_wrap=heading.startswith("|"),
            overflow="fold",
        )
    return table
