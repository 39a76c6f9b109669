"""Progress of a command: bars on a terminal, otherwise one line per stage."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.progress import Progress as Bars

from torquebench.cli.terminal.compilation import telling_compilation
from torquebench.cli.terminal.console import is_quiet, stderr_console

TITLE_COLUMNS = 38


class Attendance(Protocol):
    """Reads keys while no question is asked; see `cli.terminal.presence`."""

    def pause(self) -> None:
        """Stop reading keys during a question."""

    def resume(self, *, answered: bool) -> None:
        """Read keys again."""


class TerminalProgress:
    """Show the stages of a campaign on standard error, within 80 columns.

    As a context manager, it restores the terminal at the end, even after an error.

    Attributes
    ----------
    attendance : Attendance or None
        Notified when a question begins and ends.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or stderr_console()
        self._drawn = self._console.is_terminal and not is_quiet()
        self._bars = Bars(
            TextColumn(f"{{task.description:<{TITLE_COLUMNS}}}"),
            BarColumn(bar_width=16),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=self._console,
            disable=not self._drawn,
        )
        self._compiling = telling_compilation(self._bars.console)
        self.attendance: Attendance | None = None
        self._task: TaskID | None = None
        self._title = ""
        self._total: int | None = None
        self._since = 0.0

    def __enter__(self) -> Self:
        self._compiling.__enter__()
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish()
        self._bars.stop()
        self._compiling.__exit__(kind, error, trace)

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps (None if unknown), and end the previous one."""
        self.finish()
        self._title, self._total, self._since = title, total, time.monotonic()
        if self._drawn:
            self._task = self._bars.add_task(title, total=total)
        elif not is_quiet():
            self._console.print(title + (f" ({total})" if total else ""))

    def reach(self, done: int, detail: str = "") -> None:
        """Show the number of finished steps, and the present step."""
        if self._task is not None:
            title = f"{self._title}: {detail}" if detail else self._title
            self._bars.update(self._task, completed=done, description=title[:TITLE_COLUMNS])

    def finish(self, detail: str = "") -> None:
        """End the stage, with its result in a few words."""
        if not self._title:
            return
        title = f"{self._title}: {detail}" if detail else self._title
        if self._task is not None:
            completed = self._bars.tasks[self._bars.task_ids.index(self._task)].completed
            total = self._total or max(int(completed), 1)
            self._bars.update(
                self._task, description=title[:TITLE_COLUMNS], total=total, completed=total
            )
        elif detail and not is_quiet():
            self._console.print(f"{title} ({time.monotonic() - self._since:.1f} s)")
        self._task, self._title, self._total = None, "", None

    def say(self, text: str) -> None:
        """Print a line above the bars."""
        self._console.print(text, style="dim")

    def pause(self) -> None:
        """Stop redrawing and reading keys, so that a question can be asked."""
        if self.attendance is not None:
            self.attendance.pause()
        self._bars.stop()

    def resume(self, *, answered: bool = False) -> None:
        """Continue redrawing; state whether the answer was given at this terminal."""
        self._bars.start()
        if self.attendance is not None:
            self.attendance.resume(answered=answered)
