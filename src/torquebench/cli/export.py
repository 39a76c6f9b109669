"""`torquebench records export`: write a run as a folder that can be read without torquebench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    DataOption,
    check_output_folder,
    data_directory,
)
from torquebench.message import Message
from torquebench.operations.result import Result

__all__ = ["export"]


@dataclass(frozen=True, kw_only=True)
class ExportedRun(Result):
    """An exported run."""

    folder: str


def export(
    run: Annotated[str, typer.Argument(help="A run's id or its beginning, or `latest`.")],
    out: Annotated[Path, typer.Option(help="A folder that doesn't exist yet, or is empty.")],
    data: DataOption = DEFAULT_DATA,
) -> ExportedRun:
    """Write all data of a run as CSV, JSON, PDF and XML, with a README."""
    from torquebench.operations.records import find_run
    from torquebench.records import Registry
    from torquebench.reports.export import export_run

    check_output_folder(out)
    with Registry.open(data_directory(data)) as registry:
        exported = export_run(registry, find_run(registry, run), out)
    return ExportedRun(
        headline=Message("{count} files.", len(exported.files)),
        remarks=tuple(exported.remarks),
        files=tuple(str(exported.folder / name) for name in exported.files),
        folder=str(exported.folder),
    )
