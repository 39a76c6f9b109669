"""`torquebench records export`: a run as a folder that is readable without torquebench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    DataOption,
    check_output_folder,
    data_directory,
)
from torquebench.cli.terminal.console import answer, say, warn
from torquebench.cli.terminal.console import out as results
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.records import Registry, RunSummary

__all__ = ["export", "find_run"]


def export(
    run: Annotated[str, typer.Argument(help="A run's id or its beginning, or `latest`.")],
    out: Annotated[Path, typer.Option(help="A folder that doesn't exist yet, or is empty.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Write all data of a run as CSV, JSON, PDF and XML, with a README."""
    from torquebench.records import Registry
    from torquebench.reports.export import export_run

    check_output_folder(out)
    with Registry.open(data_directory(data)) as registry:
        exported = export_run(registry, find_run(registry, run), out)
    for remark in exported.remarks:
        warn(remark)
    say(f"{len(exported.files)} files")
    results().print(str(exported.folder), markup=False, soft_wrap=True)
    answer(folder=exported.folder, files=[exported.folder / name for name in exported.files])


def find_run(registry: Registry, name: str) -> RunSummary:
    """Return the run of this name, beginning of a name, or `latest`."""
    found = registry.runs(limit=1) if name == "latest" else registry.runs_beginning(name, limit=2)
    if len(found) == 1 or (found and found[0].run_id == name):
        return found[0]
    if found:
        raise InputError(
            Message("several runs begin with {name!r}", name), "one run", "give more of its id"
        )
    raise InputError(Message("no run {run!r}", name), "a name from `torquebench records list`")
