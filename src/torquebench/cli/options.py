"""Options shared by several commands."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from torquebench.atomic_write import is_standard_output
from torquebench.cli.terminal.console import (
    claim_file,
    leave_standard_output,
)
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench import BenchDescription
    from torquebench.chain import Timebase
    from torquebench.panel.address import Address

HELP_MARKUP: Literal["markdown"] = "markdown"
"""Markup of help texts that wraps paragraphs and leaves square brackets alone.
"""
DEFAULT_DATA = Path("torquebench-data")
CSV_ENDINGS = (".csv", ".txt", ".tsv")


class Module(StrEnum):
    """Module of the bench."""

    input = "input"
    output = "output"


ModuleArgument = Annotated[Module, typer.Argument(help="Which module.")]
DataOption = Annotated[
    Path,
    typer.Option(
        "--data",
        envvar="TORQUEBENCH_DATA",
        help="Folder of the registry and of all runs.",
    ),
]
BenchOption = Annotated[
    Path | None,
    typer.Option("--bench", help="Bench description; without it the simulated bench."),
]
RecordsOption = Annotated[
    Path | None,
    typer.Option(
        help="Folder of the records; without it, records of simulated runs are discarded."
    ),
]
YesOption = Annotated[
    bool, typer.Option("--yes", "-y", help="Confirm all questions without asking.")
]
RealTimeOption = Annotated[
    bool, typer.Option("--real-time", help="Simulated time follows the wall clock.")
]


@dataclass(frozen=True)
class CounterOptions:
    """Options of commands that may use models made with another counter."""

    accept_counter: Annotated[
        str | None,
        typer.Option(
            help="Also use models that were made with this counter (serial/clock), with more "
            "uncertainty.",
        ),
    ] = None
    clock_tolerance_ppm: Annotated[
        float,
        typer.Option(
            "--clock-tolerance",
            min=0.001,
            max=1000,
            help="Largest difference of the two counters' clocks, ppm.",
        ),
    ] = 100.0

    def accepted(self) -> Timebase | None:
        """Return the other counter whose models are accepted, None if none is named."""
        from torquebench.chain import Timebase

        if not self.accept_counter:
            return None
        return Timebase("accepted by its name", self.accept_counter, self.clock_tolerance_ppm)


@dataclass(frozen=True)
class AddressOptions:
    """The options of every command that serves pages."""

    host: Annotated[
        str, typer.Option(help="Address to listen on; others than loopback need TLS.")
    ] = "127.0.0.1"
    tls_cert: Annotated[Path | None, typer.Option(help="Certificate chain, PEM.")] = None
    tls_key: Annotated[Path | None, typer.Option(help="Its private key, PEM.")] = None
    insecure_network: Annotated[
        bool,
        typer.Option(
            "--insecure-network",
            help="Allow other machines without TLS: passwords are sent unencrypted.",
        ),
    ] = False
    host_name: Annotated[
        list[str] | None,
        typer.Option(help="A further host name of this machine; may be repeated."),
    ] = None

    def address(self, port: int, proxy: str = "") -> Address:
        """Check and return the address, before imports that take seconds."""
        from torquebench.panel.address import Address

        names = tuple(self.host_name or ())
        address = Address(
            self.host,
            port,
            self.tls_cert,
            self.tls_key,
            self.insecure_network,
            names,
            proxy,
        )
        address.check()
        return address


def named_values(texts: Sequence[str] | None, option: str, example: str) -> dict[str, str]:
    """Parse texts `NAME=VALUE` into values by name.

    Examples
    --------
    >>> named_values(["epochs=2000"], "--parameter", "epochs=20000")
    {'epochs': '2000'}
    """
    values: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise InputError(
                Message("{option} {text!r}", option, text),
                "NAME=VALUE",
                Message("write it as {example}", example),
            )
        if name in values:
            raise InputError(Message("{option} {name} twice", option, name), "once")
        values[name] = value
    return values


def bench_description(path: Path | None) -> BenchDescription:
    """Load the named bench description, by default that of the simulated bench.

    Raises
    ------
    InputError
        Where the description can't be read or is invalid.
    """
    from torquebench.bench import default_bench, load_bench

    return default_bench() if path is None else load_bench(path)


def check_output(path: Path, *inputs: Path, endings: Sequence[str] = ()) -> Path:
    """Raise an error for an output file that can't be written, before any work is done.

    Parameters
    ----------
    path : pathlib.Path
        The output file; for standard output, results are printed to standard error instead.
    *inputs : pathlib.Path
        Input files, which must not be overwritten; ``-`` is standard input.
    endings : sequence of str, optional
        Suffixes of the format that is written, or "table"; those of other formats are refused.

    Raises
    ------
    InputError
        Where the folder doesn't exist, the path is a folder, an input or another output, or the
        suffix is that of another format.
    """
    if endings and path.suffix.lower() not in endings:
        from torquebench.tables.formats import endings as endings_of_tables

        if "table" in endings:
            endings = endings_of_tables(written=True)
        known = {
            *endings_of_tables(),
            ".json",
            ".html",
            ".htm",
            ".pdf",
            ".h",
            ".st",
            ".onnx",
        }
        if path.suffix.lower() in known.difference(endings):
            raise InputError(
                path.name,
                Message("a file that ends in {endings}", " or ".join(endings)),
                "choose such an ending",
            )
    if is_standard_output(path):
        leave_standard_output()
        return path
    if path.is_dir():
        raise InputError(Message("{path} is a folder", path), "a file name", "name a file in it")
    folder = path.resolve().parent
    if not folder.is_dir():
        named = folder if path.is_symlink() else path.parent
        raise InputError(
            Message("{path}: there is no folder {parent}", path, named),
            "a folder that exists",
            "create it first",
        )
    for source in inputs:
        if str(source) != "-" and path.resolve() == source.resolve():
            raise InputError(
                Message("{path} is both input and output", path),
                "two different files",
                "name another --out",
            )
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(
            Message("{path} has no write permission", path),
            "a file that can be written",
            "name another file",
        )
    if path.is_file() or not path.exists():
        claim_file(path)
    return path


def check_output_folder(path: Path) -> Path:
    """Raise an error for an output folder that isn't a folder, before any work is done.

    Raises
    ------
    InputError
        Where the path is standard output, a file or a device.
    """
    if is_standard_output(path) or (path.exists() and not path.is_dir()):
        what = (
            "standard output, for several files"
            if str(path) == "-"
            else Message("{path} is a file", path)
        )
        raise InputError(what, "a folder", "name a folder")
    return path


def moment_in_utc(text: str) -> datetime:
    """Parse an option as a time; a day, or a time without a zone, is in UTC."""
    try:
        moment = datetime.fromisoformat(text.strip())
        return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise typer.BadParameter(
            f"{text!r}; allowed: a day such as 2026-01-31, or 2026-01-31T14:05+01:00"
        ) from error
