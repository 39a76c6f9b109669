"""`torquebench plant`: many benches in one registry."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.text import Text

from torquebench.cli.extension import (
    DEFAULT_DATA,
    HELP_MARKUP,
    WITHOUT_RESULT,
    AddressOptions,
    DataOption,
    TerminalProgress,
    Told,
    check_output,
    data_directory,
    moment_in_utc,
    narrow_table,
    note,
    out,
    say,
    say_file,
    warn,
)
from torquebench.errors import InputError
from torquebench.operations import HIDDEN
from torquebench.units import DAY, HOUR, MINUTE

WITHOUT_RESULT["plant view"] = "serves the plant's view until it is ended"


@dataclass(frozen=True)
class RegisteredBench:
    """A bench, and the URL with which it sends."""

    number: int
    name: str
    place: str
    url: str


@dataclass(frozen=True, kw_only=True)
class Registered(Told):
    """The new bench of a plant."""

    benches: Sequence[RegisteredBench]


@dataclass(frozen=True)
class ListedBench:
    """One bench of a plant."""

    number: int
    name: str
    place: str
    entries: int
    runs: int
    folders: int
    last_contact: datetime | None
    replaced_by: int | None
    ahead_s: float


@dataclass(frozen=True, kw_only=True)
class ListedBenches(Told):
    """Benches of a plant."""

    benches: Sequence[ListedBench]


@dataclass(frozen=True, kw_only=True)
class MadePlant(Told):
    """A plant's registry, or a user of it."""

    plant: str
    folders: str = ""
    url: str = ""


@dataclass(frozen=True, kw_only=True)
class Sent(Told):
    """Data sent by a bench."""

    bench: str
    entries: int
    folders: int
    bytes: int
    withdrawn: Sequence[str]
    problems: Sequence[str]
    clock: str
    chain_end: str

    @property
    def failed(self) -> bool:
        """Whether a folder couldn't be sent."""
        return bool(self.problems)


@dataclass(frozen=True)
class ListedRun:
    """One run of a plant."""

    run: str
    bench: str
    kind: str
    started: datetime
    status: str
    specimen_type: str
    serial: str
    batch: str
    simulated: bool
    withdrawn: bool


@dataclass(frozen=True, kw_only=True)
class ListedRuns(Told):
    """Runs of a plant, the newest first."""

    runs: Sequence[ListedRun]


@dataclass(frozen=True, kw_only=True)
class Withdrawn(Told):
    """A run that was withdrawn, and in how many registries it was known."""

    run: str
    bench: str
    known: int


@dataclass(frozen=True)
class VerifiedBench:
    """One bench's hash chain in the plant."""

    bench: str
    entries: int
    defects: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class VerifiedPlant(Told):
    """All chains of a plant."""

    benches: Sequence[VerifiedBench]

    @property
    def failed(self) -> bool:
        """Whether a record or file was changed."""
        return any(each.defects for each in self.benches)


@dataclass(frozen=True, kw_only=True)
class Answered(Told):
    """An answer of the plant as a table: names end with their unit, values are in the rows."""

    title: str
    rows: Sequence[Mapping[str, Any]]
    facts: Mapping[str, Any]
    notes: Sequence[str]
    differing: bool = data_field(default=False, metadata=HIDDEN)

    @property
    def failed(self) -> bool:
        """Whether benches differ, or runs couldn't be evaluated."""
        return self.differing


if TYPE_CHECKING:
    from torquebench_plant import Forwarded, Plant, PlantRun

app = typer.Typer(
    name="plant",
    help="Many benches in one registry on a PostgreSQL server: what they measured, what is due.",
    no_args_is_help=True,
    rich_markup_mode=HELP_MARKUP,
)

PlantOption = Annotated[
    str,
    typer.Option(
        "--plant",
        envvar="TORQUEBENCH_PLANT",
        help="URL of the plant's registry: postgresql://user:password@server/database.",
    ),
]


def opened(url: str, written: Path | None = None) -> Plant:
    """Open the plant's registry that a command names, after a check of the file that it writes."""
    from torquebench_plant import Plant

    if written is not None:
        from torquebench.tables import check_written

        check_written(written)
        check_output(written)
    return Plant.open(_named(url))


def _named(url: str) -> str:
    if not url:
        raise InputError(
            "no plant's registry named",
            "--plant postgresql://user:password@server/database",
            "give it, or set TORQUEBENCH_PLANT",
        )
    return url


@app.command("init")
def init(
    folders: Annotated[
        str, typer.Option(help="Where sealed run folders go: file:///srv/plant or s3://bucket/…")
    ],
    plant: PlantOption = "",
) -> MadePlant:
    """Create a plant's registry in an existing, empty database.

    The user of the URL must be allowed to create tables and roles (CREATEROLE).
    """
    from torquebench_plant import FolderStore, Plant

    FolderStore(folders)
    with Plant.create(_named(plant), folders) as made:
        say(f"A plant's registry is in {escape(made.name)}; folders go to {escape(folders)}.")
        name = made.name
        _warn_of_open_rights(made)
    say("Next: torquebench plant register NAME, once per bench.")
    return MadePlant(headline="A plant's registry was made.", plant=name, folders=folders)


def _warn_of_open_rights(plant: Plant) -> None:
    if missing := plant.open_rights():
        warn(
            "a bench's role could fill the disk with large objects or temporary tables; have the "
            "server's administrator run in this database: " + "; ".join(missing)
        )


@app.command("register")
def register_bench(
    name: Annotated[str, typer.Argument(help="Name of the bench.")],
    place: Annotated[str, typer.Option(help="Location of the bench, such as 'Hall 3'.")] = "",
    replaces: Annotated[
        int | None,
        typer.Option(help="Number of the bench whose registry was rebuilt."),
    ] = None,
    plant: PlantOption = "",
) -> Registered:
    """Register a bench and print the URL with which it sends; it can only add its own rows."""
    with opened(plant) as found:
        number, url = found.register_bench(name, place, replaces=replaces)
        _warn_of_open_rights(found)
    shown = url.render_as_string(hide_password=False)
    say(f"Bench {number} {escape(name)} is registered. On the bench, once:")
    out().print(
        f"export TORQUEBENCH_PLANT='{shown}'",
        soft_wrap=True,
        markup=False,
    )
    say("The password in it isn't shown again. Then: torquebench plant push --every 60")
    return Registered(
        headline=f"Bench {number} {name} is registered.",
        benches=[RegisteredBench(number, name, place, shown)],
    )


@app.command("add-reader")
def add_reader(
    name: Annotated[str, typer.Argument(help="Name of the new role in the database.")],
    plant: PlantOption = "",
) -> MadePlant:
    """Create a user with read access only, and print the URL."""
    with opened(plant) as found:
        url = found.add_reader(name)
        shown = url.render_as_string(hide_password=False)
        where = found.name
    out().print(shown, soft_wrap=True, markup=False)
    return MadePlant(headline=f"{name} may read {where}.", plant=where, url=shown)


@app.command("push")
def push(
    every: Annotated[
        float | None,
        typer.Option(min=0.5, help="Repeat at this interval in seconds, until Ctrl-C."),
    ] = None,
    plant: PlantOption = "",
    data: DataOption = DEFAULT_DATA,
) -> Sent:
    """Send new records of this bench to the plant, and apply the plant's withdrawals.

    The bench may run at the same time. Records that can't be sent stay here and are sent next time.
    Exit code 1 if a folder couldn't be sent.
    """
    from torquebench.records import Registry, UnavailableError
    from torquebench_plant import forward

    url, down_since, clock = _named(plant), None, ""
    with Registry.open(data_directory(data)) as registry:
        while True:
            try:
                with TerminalProgress() as progress:
                    done = forward(registry, url, progress, told=warn)
            except UnavailableError as error:
                if every is None:
                    raise
                if down_since is None:
                    down_since = datetime.now(UTC)
                    warn(f"{error.found}; everything stays here and is sent later")
            else:
                if down_since is not None:
                    note(f"the link is back; it was down since {down_since:%Y-%m-%d %H:%M:%S} UTC")
                    down_since = None
                if done.clock and not clock:
                    warn(done.clock)
                clock = done.clock
                if every is None or done.entries or done.folders or done.withdrawn:
                    _print_sent(done)
                if every is None:
                    return Sent(
                        headline=f"Bench {done.bench} has sent its records.",
                        bench=done.bench,
                        entries=done.entries,
                        folders=done.folders,
                        bytes=done.size,
                        withdrawn=done.withdrawn,
                        problems=done.problems,
                        clock=done.clock,
                        chain_end=str(done.head),
                    )
            time.sleep(every or 0.0)


def _print_sent(done: Forwarded) -> None:
    say(
        f"bench {escape(done.bench)}: {done.entries} entries and {done.folders} run folders "
        f"({done.size / 1e6:.1f} MB) sent"
    )
    for said in done.withdrawn:
        warn(said)
    say(f"the plant has this bench's chain up to entry {done.head.sequence}")


@app.command("status")
def status(plant: PlantOption = "") -> ListedBenches:
    """List the benches, how much of each has arrived, and the time of the last contact."""
    with opened(plant) as found:
        states = found.benches()
    now = datetime.now(UTC)
    table = narrow_table(
        columns=(">no.", "bench", "place", ">|entries", ">|runs", ">|folders", ">|heard from"),
        caption=f"{len(states)} benches",
    )
    for each in states:
        heard = "never" if each.last_contact is None else _ago(now, each.last_contact)
        if each.replaced_by is not None:
            heard = f"now {each.replaced_by}"
        elif each.ahead_s:
            warn(
                f"bench {each.title}: its newest entry is dated {each.ahead_s / DAY:.3g} days in "
                "the future; its clock was wrong, and so are the times of its results"
            )
        table.add_row(
            str(each.number),
            escape(each.name),
            escape(each.place),
            str(each.head.sequence),
            str(each.runs),
            str(each.folders),
            heard,
        )
    out().print(table)
    return ListedBenches(
        headline=f"{len(states)} benches.",
        benches=[
            ListedBench(
                each.number,
                each.name,
                each.place,
                each.head.sequence,
                each.runs,
                each.folders,
                each.last_contact,
                each.replaced_by,
                each.ahead_s,
            )
            for each in states
        ],
    )


def _ago(now: datetime, then: datetime) -> str:
    seconds = max((now - then).total_seconds(), 0.0)
    for size, unit in ((DAY, "d"), (HOUR, "h"), (MINUTE, "min")):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit} ago"
    return "now"


@app.command("runs")
def runs(
    limit: Annotated[int, typer.Option(min=1, help="Number of newest runs.")] = 100,
    bench: Annotated[int | None, typer.Option(help="Number of the bench.")] = None,
    kind: Annotated[str | None, typer.Option(help="Such as test-hysteresis.")] = None,
    status: Annotated[str | None, typer.Option(help="completed, aborted, failed …")] = None,
    specimen_type: Annotated[str | None, typer.Option("--type", help="Of the specimen.")] = None,
    serial: Annotated[str | None, typer.Option(help="Of the specimen.")] = None,
    batch: Annotated[str | None, typer.Option(help="Of the specimen.")] = None,
    operator: Annotated[str | None, typer.Option(help="Who measured.")] = None,
    withdrawn: Annotated[
        bool | None, typer.Option("--withdrawn/--counting", help="Only these.")
    ] = None,
    plant: PlantOption = "",
) -> ListedRuns:
    """List runs of all benches, newest first, by any filter."""
    with opened(plant) as found:
        listed = found.runs(
            limit,
            bench_key=bench,
            kind=kind,
            status=status,
            specimen_type=specimen_type,
            serial=serial,
            batch=batch,
            operator=operator,
            withdrawn=withdrawn,
        )
    table = narrow_table(
        columns=("run", "bench", "specimen", "|state"),
        caption=f"{len(listed)} runs, the newest first",
    )
    for run in listed:
        table.add_row(run.run_id, escape(run.bench), escape(run.serial), _state(run))
    out().print(table)
    return ListedRuns(
        headline=f"{len(listed)} runs.",
        runs=[
            ListedRun(
                run.run_id,
                run.bench,
                run.kind,
                run.started,
                run.status,
                run.specimen_type,
                run.serial,
                run.batch,
                run.simulated,
                run.withdrawn is not None,
            )
            for run in listed
        ],
    )


def _state(run: PlantRun) -> str:
    said = "withdrawn" if run.withdrawn is not None else run.status
    return f"{said} sim" if run.simulated else said


@app.command("withdraw")
def withdraw(
    run_id: Annotated[str, typer.Argument(help="The run.")],
    by: Annotated[str, typer.Option(help="Who decides it.")],
    reason: Annotated[str, typer.Option(help="Why.")],
    bench: Annotated[
        int | None, typer.Option(help="Number of the bench, if several have a run of this name.")
    ] = None,
    plant: PlantOption = "",
) -> Withdrawn:
    """Withdraw a run everywhere: queries no longer use it, and its bench is informed.

    The bench stops using a model that was fitted to the run. The run's folder and rows are kept.
    """
    with opened(plant) as found:
        run = found.run(run_id, bench)
        marked = found.withdraw(run, by=by, reason=reason)
    others = "" if marked == 1 else f", known {marked} times"
    say(f"run {run_id} of bench {escape(run.bench)} is withdrawn{others}")
    return Withdrawn(
        headline=f"Run {run_id} is withdrawn.", run=run_id, bench=run.bench, known=marked
    )


@app.command("verify")
def verify(
    bench: Annotated[int | None, typer.Option(help="Only this bench, by its number.")] = None,
    folders: Annotated[
        bool, typer.Option("--folders", help="Read every folder and compare its files too.")
    ] = False,
    plant: PlantOption = "",
) -> VerifiedPlant:
    """Check the stored hash chain of every bench, and with `--folders` every file.

    Exit code 1 if a record or file was changed.
    """
    verified: list[VerifiedBench] = []
    with opened(plant) as found, TerminalProgress() as progress:
        states = [each for each in found.benches() if bench in (None, each.number)]
        progress.start("Checking chains", len(states))
        for number, state in enumerate(states, 1):
            checked, wrong = found.verify_chain(state)
            if folders:
                wrong += found.verify_folders(state.number)
            progress.reach(number)
            verified.append(VerifiedBench(state.title, checked, wrong))
            said = f"{checked} entries unchanged" if not wrong else "NOT INTACT"
            say(f"bench {escape(state.title)}: {said}")
            for each in wrong:
                warn(each)
    return VerifiedPlant(headline=f"{len(verified)} chains.", benches=verified)


# -- questions ------------------------------------------------------------------------------------

if TYPE_CHECKING:
    from torquebench_plant import Answer, Plant, SpecimenFilter

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
ToleranceOption = Annotated[
    float,
    typer.Option(min=1e-6, help="Tolerance of the span's drift, in % (zero: % of range)."),
]
BaseOption = Annotated[
    int | None,
    typer.Option(min=3, help="Number of first values from which the limits are computed."),
]


def show(found: Answer, path: Path | None) -> Answered:
    """Print an answer within 80 columns, and write it to a file if one is named."""
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
    return Answered(
        headline=found.title,
        simulated=found.simulated,
        title=found.title,
        rows=rows,
        facts=found.facts,
        notes=found.notes,
    )


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
    """Options that choose specimens and the quantity."""

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
    """Options for the plant's URL and the answer's file."""

    out_file: OutOption = None
    plant: PlantOption = ""

    def show(self, ask: Callable[[Plant], Answer]) -> Answered:
        """Ask the plant, print its answer, and write it to a file if one is named."""
        with opened(self.plant, self.out_file) as plant:
            answered = ask(plant)
        return show(answered, self.out_file)


@app.command("due")
def due(
    within: Annotated[int, typer.Option(min=0, help="How many days to look ahead.")] = 30,
    tolerance: ToleranceOption = 0.1,
    *,
    options: AnswerOptions,
) -> Answered:
    """List transducers and standards that are due for calibration, with their places.

    A transducer is due on its calibration's last day, or before its drift leaves the tolerance.
    """
    from torquebench_plant import due as asked

    return options.show(lambda plant: asked(plant, within, tolerance_percent=tolerance))


@app.command("drift")
def drift(
    serial: Annotated[str | None, typer.Argument(help="Serial number of a transducer.")] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            help="All transducers of this model instead, from the points of their calibrations."
        ),
    ] = None,
    tolerance: ToleranceOption = 0.1,
    base: BaseOption = None,
    *,
    options: AnswerOptions,
) -> Answered:
    """Show the drift of a transducer over time and all benches, or of one kind (`--kind`)."""
    from torquebench_plant import drift as asked
    from torquebench_plant import drift_of_kind

    if (serial is None) == (kind is None):
        raise InputError("a serial number and --kind, or neither", "one of them")
    if kind is not None:
        return options.show(lambda plant: drift_of_kind(plant, kind))
    return options.show(lambda plant: asked(plant, serial or "", tolerance, base=base))


@app.command("specimens")
def specimens(
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> Answered:
    """List the values of a quantity of all specimens of a type, one row for each specimen."""
    from torquebench_plant import specimens as asked

    return options.show(lambda plant: asked(plant, specimens.chosen()))


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
) -> Answered:
    """Show Cp and Cpk of a type with their intervals, over all benches and for each.

    Limits are those of the latest test's data sheet, or are given here.
    """
    from torquebench_plant import capability as asked

    chosen = specimens.chosen()
    return options.show(lambda plant: asked(plant, chosen, lower=lower, upper=upper, level=level))


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
) -> Answered:
    """Show control charts of a type: single values (Shewhart) and weighted averages (EWMA)."""
    from torquebench_plant import charts as asked

    chosen = specimens.chosen()
    return options.show(lambda plant: asked(plant, chosen, base=base, weight=weight, width=width))


@app.command("outliers")
def outliers(
    *,
    specimens: SpecimenOptions,
    options: AnswerOptions,
) -> Answered:
    """Show outliers of a type: benches, batches and single specimens."""
    from torquebench_plant import outliers as asked

    return options.show(lambda plant: asked(plant, specimens.chosen()))


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
) -> Answered:
    """Compare benches by a specimen that all of them tested: E_n numbers.

    Exit code 1 if a bench differs by more than the uncertainties (|E_n| above 1).
    """
    from torquebench_plant import compare as asked

    compared = options.show(lambda plant: asked(plant, serial, quantity, reference=reference))
    differing = [row["bench"] for row in compared.rows if row["verdict"] != "agrees"]
    if differing:
        warn(f"|E_n| above 1: {', '.join(differing)}")
    return replace(compared, differing=bool(differing))


@app.command("reevaluate")
def reevaluate(
    scheduler: Annotated[
        str, typer.Option(help="serial, processes, or the address of a Dask cluster: tcp://…")
    ] = "processes",
    workers: Annotated[int | None, typer.Option(min=1, help="How many processes.")] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(help="Only runs of calibrate, check, verify or test; repeatable."),
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
) -> Answered:
    """Refit and evaluate every recorded run with this version, and show the changes.

    The results are stored in addition to the old ones. After an interruption, the command continues
    where it stopped. The results don't depend on the scheduler. Exit code 1 if runs couldn't be
    evaluated.
    """
    from torquebench import __version__
    from torquebench_plant import differences
    from torquebench_plant import reevaluate as again
    from torquebench_plant.reevaluation import KINDS

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
        shown = show(differences(found, name, against), options.out_file)
    return replace(shown, differing=done.problems > 0)


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
