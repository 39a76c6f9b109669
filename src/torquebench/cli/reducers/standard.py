"""`torquebench test standard-reducer`: end-to-end check of the bench with known friction."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.answers import FRICTION_POINT, STANDARD_REDUCER
from torquebench.cli.chain_words import tell_compensation
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.mounting import MountingOption, mounting_record, recorded
from torquebench.cli.options import BenchOptions, CounterOptions
from torquebench.cli.reports import check_reports, report_option, write_reports
from torquebench.cli.terminal.confirming import confirm_test
from torquebench.cli.terminal.console import answer, narrow_table, out, say

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.campaign.standard_reducer import StandardReducerCheck
    from torquebench.reducers import ReducerDescription


def standard_reducer(
    reducer: Annotated[
        str | None,
        typer.Option(
            help="Its description (.toml) with [[certified_friction]]; by default that of the "
            "simulated bench, with its certificate.",
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
    report: Annotated[list[Path] | None, report_option("a report with a figure")] = None,
    mounting: MountingOption = None,
    *,
    options: BenchOptions,
    counter: CounterOptions,
) -> None:
    """Measure a standard reducer's certified friction: error and repeatability with a verdict.

    The input is driven in steps of speed up to 1200 rpm, output free, three repeats. The input
    module is compensated by its active model; without one, the result says so. Exit code 1 if error
    or repeatability exceeds the tolerance.
    """
    check_reports(report)
    described = options.description()
    kind, entered = _kind(reducer, described), mounting_record(mounting)
    if kind is not None:
        confirm_test(described, kind, options.yes)
    with recorded(entered):
        found = _measured(described, kind, tolerance, repeats, both_directions, options, counter)
    _print(found)
    if report:
        from torquebench.reports.reducers.standard import standard_reducer_page

        page = standard_reducer_page(
            found.check,
            name=found.reducer.name,
            certificate=found.reducer.certificate,
            compensation=found.compensation,
            run_id=found.run_id,
            simulated=found.simulated,
        )
        write_reports(page, report)
    if not found.check.kept:
        raise typer.Exit(CHECK_FAILED)


def _kind(named: str | None, described: BenchDescription) -> ReducerDescription | None:
    """Read and check the reducer's description before a bench is opened."""
    from torquebench.campaign.standard_reducer import standard_reducer
    from torquebench.reducers import load_reducer

    kind = None if named is None else load_reducer(named)
    standard_reducer(kind, described)
    return kind


def _measured(
    described: BenchDescription,
    kind: ReducerDescription | None,
    tolerance: float,
    repeats: int,
    both: bool,
    options: BenchOptions,
    counter: CounterOptions,
) -> StandardReducerCheck:
    from torquebench.campaign.standard_reducer import check_standard_reducer, standard_reducer

    with options.open(described) as session:
        station = session.station
        states, missing = tell_compensation(station, ("input",), counter.accepted())
        answer(not_in_u=missing)
        mounted = standard_reducer(kind, described, station.drivers.reducer_certificate)
        with session.measuring() as (progress, ask):
            return check_standard_reducer(
                station,
                mounted,
                mounted.settings(repeats, both_directions=both),
                tolerance_percent=tolerance,
                compensation=states["input"],
                progress=progress,
                on_pause=ask,
            )


def _print(found: StandardReducerCheck) -> None:
    from torquebench.cli.tables import print_kept
    from torquebench.reports.errors_table import number

    check = found.check
    suffix = " - simulated" if found.simulated else ""
    table = narrow_table(
        f"{found.reducer.name}{suffix}",
        columns=(">rpm", ">known, N·m", ">mean, N·m", ">error, % FS", ">repeatability, % FS"),
        caption=f"Input module: {found.compensation}.",
    )
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
    print_kept("error", check.error_percent, check.tolerance_percent)
    print_kept("repeatability", check.repeatability_percent, check.tolerance_percent)
    say(f"Run: {found.run_id}")
    points = [FRICTION_POINT.of(point) for point in check.points]
    answer(**STANDARD_REDUCER.of(found, points=points))
