"""`torquebench records audit`: list the commands to the bench with time, person and result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.message import Message
from torquebench.operations.result import Result
from torquebench.reports.page import Page, Section, Table

__all__ = ["audit"]

SHOWN_ELSEWHERE = (
    "event",
    "time",
    "bench",
    "run",
    "operator",
    "bench_time_s",
    "instrument",
    "command",
    "by",
    "side",
    "log_line",
    "previous_sha256",
    "sha256",
)


@dataclass(frozen=True, kw_only=True)
class AuditLines(Result):
    """Lines of the audit log as they are written in its files; `earlier` ones aren't in `lines`."""

    lines: Sequence[Mapping[str, Any]]
    earlier: int

    def page(self) -> Page:
        """Return its description."""
        table = Table(
            ("time (UTC)", "bench s", "by", "what"), [_cells(each) for each in self.lines]
        )
        return Page("Audit log", "", [Section("", "", [table] * bool(self.lines))])


def audit(
    run: Annotated[
        str | None,
        typer.Argument(help="A run's id or its beginning, or `latest`; without it the whole log."),
    ] = None,
    limit: Annotated[
        int, typer.Option(min=1, help="Largest number of lines, the newest ones.")
    ] = 40,
    alarms: Annotated[
        bool, typer.Option("--alarms", help="Only alarms and acknowledgements.")
    ] = False,
    data: DataOption = DEFAULT_DATA,
) -> AuditLines:
    """Show the audit log: every command to drives, modes and clamp, alarms, runs.

    Each line is bound to bench, run and operator. The files are JSON lines: audit/audit.jsonl in
    the data directory, and audit.jsonl in each run's folder.
    """
    from torquebench.bench.audit.chain import AUDIT_FILE
    from torquebench.bench.audit.entries import AUDIT_FOLDER, read_audit
    from torquebench.operations.records import find_run
    from torquebench.records import Registry

    folder = data_directory(data)
    path = folder / AUDIT_FOLDER
    if run is not None:
        with Registry.open(folder) as registry:
            path = find_run(registry, run).folder / AUDIT_FILE
    lines = [line for line in read_audit(path) if not alarms or "alarm" in str(line.get("event"))]
    earlier = max(len(lines) - limit, 0)
    headline = Message("{count} lines.", len(lines))
    if not lines:
        headline = Message("no {what} in {path}", "alarm" if alarms else "line", path)
    elif earlier:
        headline = Message(
            "{count} lines before these; see --limit, or read {path}.", earlier, path
        )
    return AuditLines(headline=headline, lines=lines[-limit:], earlier=earlier)


def _cells(line: Mapping[str, Any]) -> tuple[str, str, str, str]:
    what = str(line.get("command") or line.get("event"))
    side = f"{line['side']} " if line.get("side") else ""
    values = ", ".join(
        f"{key}={_short(value)}"
        for key, value in line.items()
        if key not in SHOWN_ELSEWHERE and value not in ("", None, [])
    )
    if line.get("event") not in ("command", what):
        what = f"{line['event']}: {what}"
    return (
        str(line.get("time", ""))[11:23],
        f"{float(line.get('bench_time_s', 0.0)):.2f}",
        str(line.get("by", "")),
        f"{side}{what}{f' ({values})' if values else ''}",
    )


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
