"""`torquebench test standard-reducer`: the bench checked from end to end by known friction."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.confirming import confirm_test
from torquebench.cli.console import narrow_table, note, out, say
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import (
    CLOCK_TOLERANCE_PPM,
    DEFAULT_DATA,
    AcceptCounterOption,
    BenchOption,
    ClockToleranceOption,
    DataOption,
    RealTimeOption,
    accepted_counter,
    bench_description,
)
from torquebench.cli.reducer_tables import check_reports
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.chain import Timebase
    from torquebench.procedures import FrictionSettings
    from torquebench.reducers import FrictionCheck, ReducerDescription

__all__ = ["standard_reducer"]

SPEEDS_RPM = (20.0, 50.0, *(100.0 * k for k in range(1, 13)))


def standard_reducer(
    reducer: Annotated[
        str | None,
        typer.Option(
            help="Its description (.toml) with [[certified_friction]]; by default what the "
            "simulated bench holds, with its certificate.",
            show_default=False,
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            min=1e-6, max=100, help="Largest error, and difference between repeats, % FS."
        ),
    ] = 0.1,
    repeats: Annotated[int, typer.Option(min=2, max=100, help="How often it is swept.")] = 3,
    both_directions: Annotated[
        bool, typer.Option("--both-directions", help="Counter-clockwise as well.")
    ] = False,
    report: Annotated[
        list[Path] | None,
        typer.Option("--report", help="Write a report with a figure (.html or .pdf). Repeat it."),
    ] = None,
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Confirm all questions without asking.")
    ] = False,
    real_time: RealTimeOption = False,
    accept_counter: AcceptCounterOption = None,
    clock_tolerance_ppm: ClockToleranceOption = CLOCK_TOLERANCE_PPM,
) -> None:
    """Measure a standard reducer's certified friction: error and repeatability with a verdict.

    Input driven in steps of speed up to 1200 rpm, output free, three repeats. The input module is
    compensated by its active model; without one, the result says so. Leaves with 1 where error or
    repeatability exceeds the tolerance.
    """
    check_reports(report or [])
    described = bench_description(bench)
    kind = _kind(reducer, described)
    accepted = accepted_counter(accept_counter, clock_tolerance_ppm)
    if kind is not None:
        confirm_test(described, kind, yes)
    check, named, certificate, compensation, run_id = _measured(
        described, kind, tolerance, repeats, both_directions, data, accepted, yes, real_time
    )
    _print(check, named, compensation, run_id, described.simulated)
    if report:
        from torquebench.reports.page_pdf import write_report
        from torquebench.reports.standard_reducer_report import standard_reducer_page

        page = standard_reducer_page(
            check,
            name=named,
            certificate=certificate,
            compensation=compensation,
            run_id=run_id,
            simulated=described.simulated,
        )
        for path in report:
            say(f"Report: {write_report(page, path)}")
    if not check.kept:
        raise typer.Exit(CHECK_FAILED)


def _kind(named: str | None, described: BenchDescription) -> ReducerDescription | None:
    from torquebench.reducers import load_reducer

    if named is None:
        if described.simulated:
            return None
        raise InputError(
            f"no standard reducer for {described.name}",
            "a description (.toml) with [[certified_friction]]",
            "say with --reducer what is mounted",
        )
    kind = load_reducer(named)
    if not kind.certified_friction:
        raise InputError(
            f"{named}: no certified_friction",
            "[[certified_friction]] with speed_rpm, torque_nm, expanded_uncertainty_nm",
            "enter its certificate",
        )
    expected = described.bench.reducer_ratio
    if abs(kind.ratio / expected - 1.0) > 1e-6:
        raise InputError(
            f"{named}: a ratio of {kind.ratio:g}",
            f"{expected:g}, the ratio of what is mounted on {described.name}",
            "correct the reducer's description, or reducer_ratio of the bench",
        )
    return kind


def _settings(
    speeds: list[float], kind: ReducerDescription | None, repeats: int, both: bool
) -> FrictionSettings:
    from torquebench.procedures import FrictionSettings

    fastest = min(speeds[-1], SPEEDS_RPM[-1] if kind is None else kind.max_input_speed_rpm)
    wanted = tuple(speed for speed in SPEEDS_RPM if speeds[0] <= speed <= fastest)
    return FrictionSettings(
        wanted or tuple(speed for speed in speeds if speed <= fastest),
        repeats=repeats,
        counter_clockwise=both,
    )


def _measured(
    described: BenchDescription,
    kind: ReducerDescription | None,
    tolerance: float,
    repeats: int,
    both: bool,
    data: Path,
    accepted: Timebase | None,
    yes: bool,
    real_time: bool,
) -> tuple[FrictionCheck, str, str, str, str]:
    from torquebench.bench.prompts import PromptQueue, QueuedOperator
    from torquebench.campaign.measuring import RunAbortedError, measure_friction
    from torquebench.cli.interrupts import BenchInterrupts
    from torquebench.cli.measure import compensated
    from torquebench.cli.presence import attending
    from torquebench.cli.progress import TerminalProgress
    from torquebench.cli.prompts import answering
    from torquebench.cli.recovered import tell_recovered, tell_warnings
    from torquebench.reducers import check_friction
    from torquebench.station import Station

    if described.simulated:
        note("simulated bench")
    prompts = PromptQueue()
    operator = None if described.simulated else QueuedOperator(prompts)
    with Station.open(described, data, real_time=real_time, operator=operator) as station:
        tell_recovered(station)
        compensation = compensated(station, "input", accepted)
        note(f"input: {compensation}")
        certified = station.drivers.reducer_certificate if kind is None else kind.certified_friction
        settings = _settings([each.speed_rpm for each in certified] or [1.0], kind, repeats, both)
        progress = TerminalProgress()
        interrupts = BenchInterrupts(station, progress)
        try:
            with (
                progress,
                tell_warnings(station, progress),
                attending(station, progress),
                interrupts.watching(),
                answering(prompts, progress, yes=yes),
            ):
                measured = measure_friction(
                    station, settings, progress=progress, on_pause=interrupts.ask
                )
        except RunAbortedError as aborted:
            raise interrupts.reported(aborted) from None
    found = measured.result
    check = check_friction(
        found.nominal_rpm,
        found.torque_nm,
        found.repeat,
        certified,
        described.input.range_nm,
        tolerance,
    )
    named = "standard reducer of the simulated bench" if kind is None else kind.name
    certificate = "of the simulated reducer" if kind is None else kind.certificate
    return check, named, certificate, compensation, measured.record.run_id


def _print(
    check: FrictionCheck, name: str, compensation: str, run_id: str, simulated: bool
) -> None:
    from torquebench.reports.errors_table import number

    suffix = " - simulated" if simulated else ""
    table = narrow_table(f"{name}{suffix}", caption=f"Input module: {compensation}.")
    for header in ("rpm", "known, N·m", "mean, N·m", "error, % FS", "repeatability, % FS"):
        table.add_column(header, justify="right")
    for point in check.points:
        mean = sum(point.measured_nm) / len(point.measured_nm)
        table.add_row(
            f"{point.speed_rpm:g}",
            number(point.known_nm, 4),
            number(mean, 4),
            number(point.error_percent, 2),
            number(point.spread_percent, 2),
        )
    out().print(table)
    for what, value, kept in (
        ("error", check.error_percent, check.error_kept),
        ("repeatability", check.repeatability_percent, check.repeatability_kept),
    ):
        verdict = "[green]within[/green]" if kept else "[red]out of[/red]"
        say(f"{what} {number(value)} % FS: {verdict} {check.tolerance_percent:g} % FS")
    say(f"Run: {run_id}")
