"""`torquebench plant`: many benches in one registry."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import (
    DEFAULT_DATA,
    HELP_MARKUP,
    DataOption,
    check_output,
    data_directory,
)
from torquebench.cli.terminal.console import answer, narrow_table, note, out, say, warn
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.errors import InputError
from torquebench.units import DAY, HOUR, MINUTE
from torquebench_plant.cli.answers import PLANT_BENCH, PLANT_RUN, PLANT_SENT

if TYPE_CHECKING:
    from torquebench_plant import Forwarded, Plant, PlantRun

__all__ = ["PlantOption", "app", "opened"]

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
        from torquebench.tables.formats import check_written

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
) -> None:
    """Create a plant's registry in an existing, empty database.

    The user of the URL must be allowed to create tables and roles (CREATEROLE).
    """
    from torquebench_plant import FolderStore, Plant

    FolderStore(folders)
    with Plant.create(_named(plant), folders) as made:
        say(f"A plant's registry is in {escape(made.name)}; folders go to {escape(folders)}.")
        answer(plant=made.name, folders=folders)
    say("Next: torquebench plant register NAME, once per bench.")


@app.command("register")
def register_bench(
    name: Annotated[str, typer.Argument(help="Name of the bench.")],
    place: Annotated[str, typer.Option(help="Where it stands, such as 'Hall 3'.")] = "",
    replaces: Annotated[
        int | None,
        typer.Option(help="Number of the bench whose registry was rebuilt."),
    ] = None,
    plant: PlantOption = "",
) -> None:
    """Register a bench and print the URL with which it sends; it can only add its own rows."""
    with opened(plant) as found:
        number, url = found.register_bench(name, place, replaces=replaces)
    shown = url.render_as_string(hide_password=False)
    answer(benches=[{"number": number, "name": name, "place": place, "url": shown}])
    say(f"Bench {number} {escape(name)} is registered. On the bench, once:")
    out().print(
        f"export TORQUEBENCH_PLANT='{shown}'",
        soft_wrap=True,
        markup=False,
    )
    say("The password in it isn't shown again. Then: torquebench plant push --every 60")


@app.command("add-reader")
def add_reader(
    name: Annotated[str, typer.Argument(help="Name of the new role in the database.")],
    plant: PlantOption = "",
) -> None:
    """Create a user with read access only, and print the URL."""
    with opened(plant) as found:
        url = found.add_reader(name)
        shown = url.render_as_string(hide_password=False)
        answer(plant=found.name, url=shown)
    out().print(shown, soft_wrap=True, markup=False)


@app.command("push")
def push(
    every: Annotated[
        float | None,
        typer.Option(min=0.5, help="Repeat at this interval in seconds, until Ctrl-C."),
    ] = None,
    plant: PlantOption = "",
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Send new records of this bench to the plant, and apply the plant's withdrawals.

    The bench may run at the same time. Records that can't be sent stay here and are sent next time.
    Exit code 1 if a folder couldn't be sent.
    """
    from torquebench.records import Registry, UnavailableError
    from torquebench_plant import forward

    url, down_since = _named(plant), None
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
                if every is None or done.entries or done.folders or done.withdrawn:
                    _print_sent(done)
                if every is None:
                    if done.problems:
                        raise typer.Exit(CHECK_FAILED)
                    return
            time.sleep(every or 0.0)


def _print_sent(done: Forwarded) -> None:
    answer(**PLANT_SENT.of(done))
    say(
        f"bench {escape(done.bench)}: {done.entries} entries and {done.folders} run folders "
        f"({done.size / 1e6:.1f} MB) sent"
    )
    for said in done.withdrawn:
        warn(said)
    say(f"the plant has this bench's chain up to entry {done.head.sequence}")


@app.command("status")
def status(plant: PlantOption = "") -> None:
    """List the benches, how much of each has arrived, and the time of the last contact."""
    with opened(plant) as found:
        states = found.benches()
    answer(benches=[PLANT_BENCH.of(each) for each in states])
    now = datetime.now(UTC)
    table = narrow_table(
        columns=(">no.", "bench", "place", ">|entries", ">|runs", ">|folders", ">|heard from"),
        caption=f"{len(states)} benches",
    )
    for each in states:
        heard = "never" if each.last_contact is None else _ago(now, each.last_contact)
        if each.replaced_by is not None:
            heard = f"now {each.replaced_by}"
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
) -> None:
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
    answer(runs=[PLANT_RUN.of(run, withdrawn=run.withdrawn is not None) for run in listed])
    table = narrow_table(
        columns=("run", "bench", "specimen", "|state"),
        caption=f"{len(listed)} runs, the newest first",
    )
    for run in listed:
        table.add_row(run.run_id, escape(run.bench), escape(run.serial), _state(run))
    out().print(table)


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
) -> None:
    """Withdraw a run everywhere: queries no longer use it, and its bench is informed.

    The bench stops using a model that was fitted to the run. The run's folder and rows are kept.
    """
    with opened(plant) as found:
        run = found.run(run_id, bench)
        marked = found.withdraw(run, by=by, reason=reason)
    answer(run=run_id, bench=run.bench, known=marked)
    others = "" if marked == 1 else f", known {marked} times"
    say(f"run {run_id} of bench {escape(run.bench)} is withdrawn{others}")


@app.command("verify")
def verify(
    bench: Annotated[int | None, typer.Option(help="Only this bench, by its number.")] = None,
    folders: Annotated[
        bool, typer.Option("--folders", help="Read every folder and compare its files too.")
    ] = False,
    plant: PlantOption = "",
) -> None:
    """Check the stored hash chain of every bench, and with `--folders` every file.

    Exit code 1 if a record or file was changed.
    """
    problems = 0
    with opened(plant) as found, TerminalProgress() as progress:
        states = [each for each in found.benches() if bench in (None, each.number)]
        progress.start("Checking chains", len(states))
        for number, state in enumerate(states, 1):
            checked, wrong = found.verify_chain(state)
            if folders:
                wrong += found.verify_folders(state.number)
            progress.reach(number)
            problems += len(wrong)
            answer(benches=[{"bench": state.title, "entries": checked, "defects": wrong}])
            said = f"{checked} entries unchanged" if not wrong else "NOT INTACT"
            say(f"bench {escape(state.title)}: {said}")
            for each in wrong:
                warn(each)
    if problems:
        raise typer.Exit(CHECK_FAILED)
