"""`torquebench plant due`, `drift`, `specimens`, `capability`, `charts`, `outliers`, `compare`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from torquebench.cli.options import AddressOptions, moment_in_utc
from torquebench.cli.terminal.console import answer, narrow_table, note, out, say, say_file, warn
from torquebench.errors import InputError
from torquebench_plant.cli.answers import PLANT_ANSWER
from torquebench_plant.cli.commands import PlantOption, app, opened

if TYPE_CHECKING:
    from torquebench_plant import Answer, Plant, SpecimenFilter

__all__ = ["app", "show"]

LISTED = 40
"""Longer tables are printed only with `--out`."""

OutOption = Annotated[
    Path | None, typer.Option("--out", help="Write the whole table as .csv or .parquet.")
]
TypeArgument = Annotated[str, typer.Argument(help="Type, as the reducer's description names it.")]
QuantityArgument = Annotated[str, typer.Argument(help="Key of the value, such as backlash.")]
BenchNumber = Annotated[int | None, typer.Option("--bench", help="Number of one bench.")]
BatchOption = Annotated[str | None, typer.Option("--batch", help="One batch.")]
SinceOption = Annotated[
    datetime | None,
    typer.Option("--since", parser=moment_in_utc, metavar="DAY", help="From this day on (UTC)."),
]
UntilOption = Annotated[
    datetime | None,
    typer.Option("--until", parser=moment_in_utc, metavar="DAY", help="Before this day (UTC)."),
]
BaseOption = Annotated[
    int | None,
    typer.Option(min=3, help="Number of first values from which the limits are computed."),
]


def show(found: Answer, path: Path | None) -> None:
    """Print an answer within 80 columns, and write it where a file is named."""
    answer(**PLANT_ANSWER.of(found))
    simulated = " - simulated" if found.simulated else ""
    out().print(Text(f"{found.title}{simulated}", style="bold"))
    rows = found.rows()
    if rows:
        kept = [name for name in found.columns if any(row[name] not in (None, "") for row in rows)]
        table = narrow_table()
        for name in kept:
            numbers = any(isinstance(row[name], float | int) for row in rows)
            title = _HEADINGS.get(name, name.replace("_", " "))
            table.add_column(title, justify="right" if numbers else "left", overflow="fold")
        for row in found.shown(LISTED):
            table.add_row(*(Text(_short(row[name])) for name in kept))
        out().print(table)
        if len(rows) > LISTED:
            which = "last" if found.in_time else "first"
            note(f"the {which} {LISTED} of {len(rows)} rows; --out FILE.csv has all")
    for name, value in found.facts.items():
        out().print(Text(f"{name}: {_short(value)}"))
    for said in found.notes:
        say(said)
    if path is not None:
        found.write(path)
        say_file("Table", path)


_HEADINGS = {
    "expanded_uncertainty": "U",
    "standard_deviation": "s",
    "span_error_percent": "span %",
    "ewma_lower": "low",
    "ewma_upper": "high",
    "days_left": "days",
    "specimens": "n",
    "cp_low": "low",
    "cp_high": "high",
    "cpk_low": "low",
    "cpk_high": "high",
    "p_value": "p",
}


def _short(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, datetime):
        return f"{value.astimezone(UTC):%Y-%m-%d}"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


@dataclass(frozen=True)
class SpecimenOptions:
    """Which specimens, and which of their values."""

    specimen_type: TypeArgument
    quantity: QuantityArgument
    bench: BenchNumber = None
    batch: BatchOption = None
    since: SinceOption = None
    until: UntilOption = None

    def chosen(self) -> SpecimenFilter:
        """Return the filter of the plant's questions."""
        from torquebench_plant import SpecimenFilter

        return SpecimenFilter(**vars(self))


@dataclass(frozen=True)
class AnswerOptions:
    """The plant, and where its answer is written."""

    out_file: OutOption = None
    plant: PlantOption = ""

    def show(self, ask: Callable[[Plant], Answer]) -> Answer:
        """Ask the plant, print its answer and write it where a file is named."""
        with opened(self.plant, self.out_file) as plant:
            answered = ask(plant)
        show(answered, self.out_file)
        return answered


@app.command("due")
def due(
    within: Annotated[int, typer.Option(min=0, help="How many days to look ahead.")] = 30,
    *,
    options: AnswerOptions,
) -> None:
    """List transducers and standards that are due for calibration, with their places."""
    from torquebench_plant import due as asked

    options.show(lambda plant: asked(plant, within))


@app.command("drift")
def drift(
    serial: Annotated[str | None, typer.Argument(help="Serial number of a transducer.")] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            help="All transducers of this model instead, from the points of their calibrations."
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=1e-6, help="Tolerance of the span's drift, in % (zero: % of range)."),
    ] = 0.1,
    base: BaseOption = None,
    *,
    options: AnswerOptions,
) -> None:
    """Show the drift of a transducer over time and all benches, or of one kind (`--kind`)."""
    from torquebench_plant import drift as asked
    from torquebench_plant import drift_of_kind

    if (serial is None) == (kind is None):
        raise InputError("a serial number and --kind, or neither", "one of them")
    if kind is not None:
        options.show(lambda plant: drift_of_kind(plant, kind))
    else:
        options.show(lambda plant: asked(plant, serial or "", tolerance, base=base))


@app.command("specimens")
def specimens(
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> None:
    """List the values of a quantity of all specimens of a type, one row for each specimen."""
    from torquebench_plant import specimens as asked

    options.show(lambda plant: asked(plant, specimens.chosen()))


@app.command("capability")
def capability(
    lower: Annotated[float | None, typer.Option(help="Lower limit, in the value's unit.")] = None,
    upper: Annotated[float | None, typer.Option(help="Upper limit, in the value's unit.")] = None,
    level: Annotated[
        float, typer.Option(min=0.5, max=0.999, help="Confidence of the intervals.")
    ] = 0.95,
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> None:
    """Show Cp and Cpk of a type with their intervals, over all benches and for each.

    Limits are those of the latest test's data sheet, or are given here.
    """
    from torquebench_plant import capability as asked

    chosen = specimens.chosen()
    options.show(lambda plant: asked(plant, chosen, lower=lower, upper=upper, level=level))


@app.command("charts")
def charts(
    base: BaseOption = None,
    weight: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="EWMA: weight of the newest value.")
    ] = 0.2,
    width: Annotated[
        float, typer.Option(min=0.1, help="EWMA: limits in standard deviations.")
    ] = 2.9,
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> None:
    """Show control charts of a type: single values (Shewhart) and weighted averages (EWMA)."""
    from torquebench_plant import charts as asked

    chosen = specimens.chosen()
    options.show(lambda plant: asked(plant, chosen, base=base, weight=weight, width=width))


@app.command("outliers")
def outliers(
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> None:
    """Show outliers of a type: benches, batches and single specimens."""
    from torquebench_plant import outliers as asked

    options.show(lambda plant: asked(plant, specimens.chosen()))


@app.command("compare")
def compare(
    serial: Annotated[
        str,
        typer.Argument(help="Serial number of the specimen that was tested on several benches."),
    ],
    quantity: QuantityArgument,
    reference: Annotated[int | None, typer.Option(help="Number of the reference bench.")] = None,
    *,
    options: AnswerOptions,
) -> None:
    """Compare benches by a specimen that all of them tested: E_n numbers.

    Exit code 1 if a bench differs by more than the uncertainties (|E_n| above 1).
    """
    from torquebench.cli.failure import CHECK_FAILED
    from torquebench_plant import compare as asked

    compared = options.show(lambda plant: asked(plant, serial, quantity, reference=reference))
    differing = [row["bench"] for row in compared.rows() if row["verdict"] != "agrees"]
    if differing:
        warn(f"|E_n| above 1: {', '.join(differing)}")
        raise typer.Exit(CHECK_FAILED)


@app.command("reevaluate")
def reevaluate(
    scheduler: Annotated[
        str, typer.Option(help="serial, processes, or the address of a Dask cluster: tcp://…")
    ] = "processes",
    workers: Annotated[int | None, typer.Option(min=1, help="How many processes.")] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(help="Only runs of calibrate, check, verify or test; repeat it."),
    ] = None,
    bench: BenchNumber = None,
    label: Annotated[
        str | None, typer.Option(help="Label of the results; the version by default.")
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(help="Compare with this evaluation instead of the original results."),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=1, help="Largest number of runs to evaluate now.")
    ] = None,
    *,
    options: AnswerOptions,
) -> None:
    """Refit and evaluate every recorded run with this version, and show the changes.

    The results are stored in addition to the old ones. After an interruption, the command continues
    where it stopped. The results don't depend on the scheduler. Exit code 1 if runs couldn't be
    evaluated.
    """
    from torquebench import __version__
    from torquebench.cli.failure import CHECK_FAILED
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench_plant import differences
    from torquebench_plant import reevaluate as again
    from torquebench_plant.reevaluating import KINDS

    name = label or __version__
    with opened(options.plant, options.out_file) as found:
        with TerminalProgress() as progress:
            done = again(
                found,
                scheduler,
                workers=workers,
                label=name,
                kinds=kind or KINDS,
                bench=bench,
                limit=limit,
                progress=progress,
            )
        say(f"{done.done} runs evaluated now, {done.known} before, {done.problems} can't be")
        show(differences(found, name, against), options.out_file)
    if done.problems:
        raise typer.Exit(CHECK_FAILED)


@app.command("view")
def view(
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")
    ] = 8090,
    password: Annotated[
        str,
        typer.Option(
            envvar="TORQUEBENCH_VIEW_PASSWORD",
            help="Password of the pages; required on other addresses than loopback.",
        ),
    ] = "",
    plant: PlantOption = "",
    *,
    serving: AddressOptions,
) -> None:
    """Serve the plant's view in a browser; it needs no bench and only reads.

    Use the URL of a reader (`plant add-reader`). Ctrl-C ends it.
    """
    address = serving.address(port)
    from torquebench_plant.view import serve_plant_view

    with opened(plant) as found:
        serve_plant_view(found, address, password, lambda url: say(f"Plant: {url}"))
