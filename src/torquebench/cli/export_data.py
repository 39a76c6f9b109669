"""`torquebench records export-data`: write a run's streams for other programs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.options import DEFAULT_DATA, DataOption, check_output, data_directory
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import Result

__all__ = ["export_data"]


class Format(StrEnum):
    """Formats of streams."""

    csv = "csv"
    parquet = "parquet"
    hdf5 = "hdf5"
    tdms = "tdms"
    mdf4 = "mdf4"


class StreamName(StrEnum):
    """Streams of a run."""

    samples = "samples"
    edges = "edges"


@dataclass(frozen=True, kw_only=True)
class ExportedStream(Result):
    """A run's samples or edges for other programs."""

    run: str
    stream: str
    format: str


def export_data(
    run: Annotated[str, typer.Argument(help="A run's id or its beginning, or `latest`.")],
    out: Annotated[Path, typer.Option(help="File to write.")],
    file_format: Annotated[
        Format | None,
        typer.Option(
            "--format",
            help=(
                "By default that of the file's suffix, else CSV. TDMS, MDF4 and HDF5 need "
                "the extra of their name."
            ),
        ),
    ] = None,
    stream: Annotated[
        StreamName, typer.Option(help="Torque, angle, speed, temperature; or every edge.")
    ] = StreamName.samples,
    data: DataOption = DEFAULT_DATA,
) -> ExportedStream:
    """Write a run's samples or edges as CSV, Parquet, HDF5, TDMS or MDF4, with units."""
    from torquebench.operations.records import find_run
    from torquebench.records import Registry, RunFolder
    from torquebench.records.export.streams import export_streams

    chosen = _format(out, file_format)
    check_output(out)
    with Registry.open(data_directory(data)) as registry:
        folder = RunFolder.open(find_run(registry, run).folder)
    export_streams(folder, out, chosen.value, stream.value)
    return ExportedStream(
        headline=Message(
            "{stream} of {run} as {format}.", stream.value, folder.run_id, chosen.value
        ),
        run_ids=(folder.run_id,),
        files=(str(out),),
        run=folder.run_id,
        stream=stream.value,
        format=chosen.value,
    )


def _format(out: Path, wanted: Format | None) -> Format:
    """Return the format to write, as requested or by the file's suffix.

    Raises
    ------
    InputError
        Where the suffix is that of another format.
    """
    from torquebench.tables.formats import format_of

    found = format_of(out) if out.suffix else None
    named = "" if found is None else found.name
    if (named and named != (wanted or named)) or named not in ("", *Format):
        raise InputError(
            Message("{name} for {wanted}", out.name, wanted or named),
            "an ending of the format: .csv, .parquet, .h5, .tdms, .mf4",
            "choose such an ending, or the --format that it names",
        )
    return wanted or Format(named or "csv")
