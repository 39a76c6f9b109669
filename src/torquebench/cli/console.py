"""What every command writes with: one console each for results and for messages."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from torquebench.errors import TorquebenchError

if TYPE_CHECKING:
    from torquebench.calibration import Contradiction

__all__ = [
    "leave_standard_output",
    "narrow_table",
    "note",
    "out",
    "say",
    "stderr_console",
    "warn",
    "write_contradictions",
    "write_error",
]

PLAIN_WIDTH = 80
"""Columns where nobody looks: pipes, files and logs stay readable on any terminal."""


_standard_output_is_a_file = False


def leave_standard_output() -> None:
    """Print results to standard error from now on: a file is written to standard output."""
    global _standard_output_is_a_file
    _standard_output_is_a_file = True


def out() -> Console:
    """Return the console of results (standard output); plain where it isn't a terminal."""
    return _console(stderr=_standard_output_is_a_file)


def stderr_console() -> Console:
    """Return the console of messages and errors (standard error)."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> Console:
    console = Console(stderr=stderr, highlight=False, emoji=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = PLAIN_WIDTH
    return console


def say(text: str) -> None:
    """Print one line of result; Rich markup is understood, so escape foreign text."""
    out().print(text)


def note(text: str) -> None:
    """Print a line about the work itself, which a pipe of the results shouldn't carry."""
    stderr_console().print(Text(text, style="dim"))


def warn(text: str) -> None:
    """Print a warning to standard error."""
    stderr_console().print(f"[yellow]warning[/yellow]  {escape(text)}")


def write_error(error: TorquebenchError) -> None:
    """Print what was found, what is allowed and what to do, one line each."""
    _write_message({"error": error.found, "allowed": error.allowed, "do": error.remedy})


def write_contradictions(contradictions: Sequence[Contradiction], remedy: str) -> None:
    """Print what a calibration contradicts, what may be the cause, and what to do."""
    for each in contradictions:
        allowed = f"{each.allowed} (clause {each.clause})"
        _write_message({"contradiction": each.found, "allowed": allowed, "cause": each.cause})
    _write_message({"do": remedy})


def _write_message(parts: Mapping[str, str]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, said in parts.items():
        style = "bold red" if name in ("error", "contradiction") else "dim"
        if said:
            table.add_row(Text(name, style=style), Text(said))
    stderr_console().print(table)


def narrow_table(title: str = "", *, caption: str = "") -> Table:
    """Return a table that stays within 80 columns: thin rules, one space of padding."""
    return Table(
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
    )
