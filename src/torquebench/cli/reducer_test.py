"""`torquebench test`: a mounted reducer put to its tests, judged against its data sheet."""

from __future__ import annotations

import tempfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from torquebench.cli.console import narrow_table, note, out, say
from torquebench.cli.options import DEFAULT_DATA, BenchOption, DataOption, RealTimeOption
from torquebench.errors import InputError, ModelMismatchError

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.campaign.reducer_results import ReducerTestRecord, TestOutcome
    from torquebench.campaign.reducer_settings import ReducerTestSettings
    from torquebench.reducers import ReducerDescription
    from torquebench.station import Station

__all__ = ["register"]

CHECK_FAILED = 1


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("test")(put_to_test)


def put_to_test(
    name: Annotated[
        str,
        typer.Argument(
            help="no-load, starting, back-driving, hysteresis, transmission-error, efficiency, "
            "or full for all of them."
        ),
    ],
    reducer: Annotated[
        str, typer.Option(help="A packaged type (standard, rv-40e, harmonic-20) or a TOML file.")
    ] = "standard",
    serial: Annotated[str, typer.Option(help="Serial number of the specimen.")] = "",
    short: Annotated[
        bool, typer.Option("--short", help="A first look: few points, no warming up.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check limits and durations; nothing moves.")
    ] = False,
    data: DataOption = DEFAULT_DATA,
    bench: BenchOption = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Confirm all questions without asking.")
    ] = False,
    real_time: RealTimeOption = False,
) -> None:
    """Test a reducer, with uncertainties and a verdict against its data sheet.

    Torques are compensated by the active models; without one, the result says so. Every part is
    a run of its own; its results.json holds all numbers. Leaves with 1 where a limit isn't kept.
    """
    from torquebench.bench.description import default_bench, load_bench
    from torquebench.campaign.reducer_settings import ReducerTestSettings
    from torquebench.campaign.reducer_tests import TESTS
    from torquebench.reducers import load_reducer

    if name not in TESTS:
        raise InputError(f"a reducer test {name!r}", f"one of {', '.join(TESTS)}")
    kind = load_reducer(reducer)
    described = default_bench() if bench is None else load_bench(bench)
    described = _with_specimen(described, reducer, serial)
    settings = ReducerTestSettings.short() if short else ReducerTestSettings()
    if dry_run:
        _dry_run(described, name, kind, settings)
        return
    _confirm(described, kind, yes)
    record = _run(described, name, kind, settings, serial, data, yes=yes, real_time=real_time)
    _report(record)
    if record.failed:
        raise typer.Exit(CHECK_FAILED)


def _with_specimen(described: BenchDescription, reducer: str, serial: str) -> BenchDescription:
    """Have a simulated bench mount the packaged type; another serial is another specimen."""
    from torquebench.reducers import available_reducers

    if not described.simulated or "reducer" in described.driver:
        return described
    driver = dict(described.driver)
    if reducer in available_reducers():
        driver["reducer"] = reducer
    if serial and "reducer_seed" not in driver:
        driver["reducer_seed"] = zlib.crc32(serial.encode())
    return described.model_copy(update={"driver": driver})


def _confirm(described: BenchDescription, reducer: ReducerDescription, yes: bool) -> None:
    """Ask before a real bench moves, where somebody is there."""
    import sys

    if yes or described.simulated:
        return
    if not sys.stdin.isatty():
        raise InputError(
            f"{described.name} is a real bench and nobody is there to confirm",
            "a person at the terminal, or --yes",
            "check that nobody is at the bench, then give --yes",
        )
    note(f"{described.name}: {reducer.name} up to {reducer.rated_torque_nm:g} N·m.")
    if not typer.confirm("Is the bench clear and may it be loaded?"):
        raise typer.Exit(1)


def _dry_run(
    described: BenchDescription,
    name: str,
    reducer: ReducerDescription,
    settings: ReducerTestSettings,
) -> None:
    from torquebench.campaign.reducer_tests import rehearse_reducer_test
    from torquebench.station import Station

    with (
        tempfile.TemporaryDirectory() as scratch,
        Station.open(described, Path(scratch)) as station,
    ):
        parts = rehearse_reducer_test(station, name, reducer, settings)
    table = narrow_table(f"What would be done with {escape(reducer.name)}")
    table.add_column("", overflow="fold")
    for heading in ("time", "points", "input", "output"):
        table.add_column(heading, justify="right")
    for part in parts:
        most = [
            f"{part.largest_torque_nm[side]:.4g} N·m\n{part.largest_speed_rpm[side]:.4g} rpm"
            for side in ("input", "output")
        ]
        table.add_row(part.title, f"{part.duration_s / 60:.1f} min", str(part.points), *most)
    out().print(table)
    say("Limits and interlocks checked; nothing was moved.")


def _run(
    described: BenchDescription,
    name: str,
    reducer: ReducerDescription,
    settings: ReducerTestSettings,
    serial: str,
    data: Path,
    *,
    yes: bool,
    real_time: bool,
) -> ReducerTestRecord:
    from torquebench.bench.prompts import DeskOperator, PromptDesk
    from torquebench.campaign.measuring import RunAbortedError
    from torquebench.campaign.reducer_tests import run_reducer_test
    from torquebench.cli.interrupts import BenchInterrupts
    from torquebench.cli.progress import TerminalProgress
    from torquebench.cli.prompts import answering
    from torquebench.station import Station

    if described.simulated:
        note("simulated bench")
    desk = PromptDesk()
    operator = None if described.simulated else DeskOperator(desk)
    with Station.open(described, data, real_time=real_time, operator=operator) as station:
        _compensate(station)
        progress = TerminalProgress()
        interrupts = BenchInterrupts(station, progress)
        try:
            with progress, interrupts.watching(), answering(desk, progress, yes=yes):
                return run_reducer_test(
                    station,
                    name,
                    reducer,
                    settings,
                    serial=serial,
                    progress=progress,
                    on_pause=interrupts.ask,
                )
        except RunAbortedError as aborted:
            raise interrupts.reported(aborted) from None


def _compensate(station: Station) -> None:
    """Compensate every side that has a model; the result says which one has none."""
    from torquebench.bench.roles import SIDES

    for side in SIDES:
        try:
            station.activate_compensation(side)
        except ModelMismatchError as missing:
            note(f"{side}: {missing.found}")


def _report(record: ReducerTestRecord) -> None:
    simulated = " - simulated" if record.simulated else ""
    specimen = f" {record.serial}" if record.serial else ""
    say(f"[bold]{escape(record.reducer_name + specimen)}{simulated}[/bold]")
    for outcome in record.outcomes:
        _print_outcome(outcome)
    verdict = record.verdict
    if verdict:
        style = "red" if record.failed else "green"
        say(f"Against the data sheet: [{style}]{_words(verdict)}[/{style}]")


def _print_outcome(outcome: TestOutcome) -> None:
    from torquebench.cli.reducer_tables import stated

    table = narrow_table(outcome.title, caption="U: expanded uncertainty, 95.45 % coverage")
    table.add_column("", overflow="fold")
    for heading in ("value", "U"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("data sheet", overflow="fold")
    for each in outcome.quantities:
        value, expanded = stated(each.value, each.expanded_uncertainty)
        judged = f"{each.limit}: {_words(each.verdict)}" if each.verdict else ""
        table.add_row(escape(each.title), value, expanded, each.unit, escape(judged))
    out().print(table)
    for remark in outcome.remarks:
        say(f"[dim]{escape(remark)}[/dim]")
    say(f"Run: {outcome.run.run_id}")


def _words(verdict: str) -> str:
    from torquebench.uncertainty import Verdict

    return Verdict(verdict).label
