"""What every command writes with: one console each for results and for messages."""

from __future__ import annotations

import os

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from torquebench.errors import TorquebenchError

__all__ = [
    "leave_standard_output",
    "narrow_table",
    "note",
    "out",
    "say",
    "stderr_console",
    "warn",
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
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(Text("error", style="bold red"), Text(error.found))
    if error.allowed:
        table.add_row(Text("allowed", style="dim"), Text(error.allowed))
    if error.remedy:
        table.add_row(Text("do", style="dim"), Text(error.remedy))
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
