"""`torquebench turn`: runs with a rotating module, by profiles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.answers import TURN_PLANNED, TURNED
from torquebench.cli.options import CSV_ENDINGS, BenchOptions, Module, ModuleArgument, check_output
from torquebench.cli.terminal.confirming import confirm_turn
from torquebench.cli.terminal.console import (
    answer,
    narrow_table,
    out,
    say,
    say_file,
)
from torquebench.units import MINUTE, MS_PER_S

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.procedures.turning.profile import TurningProfile

__all__ = ["turn"]


def turn(
    side: ModuleArgument,
    result: Annotated[Path, typer.Option("--out", help="The CSV file to write.")],
    profile: Annotated[
        str, typer.Option(help="A profile's name, or the path of a .toml.")
    ] = "empty-run",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show speeds and duration; nothing moves.")
    ] = False,
    no_wait: Annotated[
        bool, typer.Option("--no-wait", help="Don't wait for temperatures.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Resume the interrupted run in the file of --out.")
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Draw the random points of a verification by another seed."),
    ] = None,
    *,
    options: BenchOptions,
) -> None:
    """Rotate a module with nothing mounted or against the calibrator, and write the table.

    Profiles: empty-run, empty-run-temperatures (waits for each), empty-run-warm-up (uses the
    bench's own warming), identification (inertia), turning-calibration, turning-verification
    (random torques and speeds, for `verify`), dynamics (steps and sines of torque against the
    calibrator at rest, for `evaluate dynamics`). Ctrl-C pauses. An aborted run keeps its complete
    series (a calibration's speeds); --resume measures the others.
    """
    from torquebench.procedures.turning.profile import load_turning_profile

    chosen = load_turning_profile(profile)
    if seed is not None:
        chosen = chosen.with_seed(seed)
    description = options.description()
    answer(side=side.value, profile=chosen.name, simulated=description.simulated)
    if dry_run:
        _dry_run(description, side, chosen)
        return
    if not resume:
        check_output(result, endings=CSV_ENDINGS)
    confirm_turn(description, side.value, chosen, options.yes)
    _run(description, side, chosen, result, options, resume=resume, wait=not no_wait)


def _run(
    description: BenchDescription,
    side: Module,
    profile: TurningProfile,
    result: Path,
    options: BenchOptions,
    *,
    resume: bool,
    wait: bool,
) -> None:
    from torquebench.campaign.turning_runs import measure_turning, read_begun

    serial = description.module(side.value).transducer.serial
    begun = read_begun(result, side.value, profile, serial) if resume else None
    with options.open(description) as session:
        try:
            with session.measuring() as (progress, ask):
                done = measure_turning(
                    session.station,
                    side.value,
                    profile,
                    result,
                    begun=begun,
                    wait=wait,
                    progress=progress,
                    on_pause=ask,
                )
        except typer.Exit:
            if result.exists():
                say_file("Complete series, --resume measures the others", result)
            raise
    simulated = " (simulated)" if description.simulated else ""
    say(f"{done.rows} rows{simulated} in {done.bench_seconds / MINUTE:.3g} min of bench time")
    say_file("Table", result)
    say(f"Run: {done.run_id}")
    answer(**TURNED.of(done))


def _dry_run(description: Any, side: Module, profile: TurningProfile) -> None:
    """Rehearse the same plan as the real run, and print it."""
    from torquebench.campaign.turning_runs import rehearse_turning
    from torquebench.cli.bench_session import rehearsing

    table = narrow_table(
        f"{profile.title or profile.name}, {side.value}", columns=("|", ""), headings=False
    )
    with rehearsing(description) as station:
        rehearsal = rehearse_turning(station, side.value, profile)
        if profile.kind == "dynamics":
            _describe_steps(table, description, side, profile)
        else:
            _describe_speeds(table, side, profile, rehearsal.points)
        waiting = "" if profile.temperatures is None else " and the waiting"
        table.add_row("duration", f"{rehearsal.duration_s / MINUTE:.3g} min{waiting}")
        out().print(table)
    answer(**TURN_PLANNED.of(rehearsal))


def _describe_speeds(table: Any, side: Module, profile: TurningProfile, points: int) -> None:
    """Add speeds, torques and temperatures."""
    top = profile.top_rpm(side.value)
    speeds = ", ".join(f"{share * top:g}" for share in profile.speed_shares)
    if profile.random is not None:
        torque = f"±{100 * profile.torque_shares[-1]:g} % of range"
        lowest = profile.speed_shares[0] * top
        table.add_row("speeds", f"random, {lowest:g} to {top:g} rpm, both directions")
        table.add_row("torques", f"random, {torque}; seed {profile.random.seed}")
        table.add_row("points", f"{points} in {profile.series()} series")
    else:
        table.add_row("speeds", f"{speeds} rpm, both directions")
    if profile.kind == "empty":
        ramps = profile.ramps
        table.add_row("ramps", f"{top / ramps.gentle_s:.3g} and {top / ramps.steep_s:.3g} rpm/s")
        table.add_row("series", f"{profile.series()} of {len(profile.legs(side.value))} legs")
    elif profile.kind == "calibration":
        torques = ", ".join(f"{100 * share:g}" for share in profile.torque_shares)
        table.add_row("torques", f"±{torques} % of range, and 0")
        table.add_row("points", str(points))
    if profile.temperatures is not None:
        wanted = ", ".join(f"{each:g}" for each in profile.temperatures.wanted_c)
        table.add_row("temperatures", f"{wanted} °C, waited for up to "
                      f"{profile.temperatures.longest_h:g} h each")  # fmt: skip


def _describe_steps(
    table: Any, description: BenchDescription, side: Module, profile: TurningProfile
) -> None:
    """Add steps and sines of torque, and what the drive makes of them."""
    module, steps, sines = description.module(side.value), profile.steps, profile.sines
    assert steps is not None
    full, rate = module.range_nm, module.drive.torque_rate_nm_per_s
    sizes = ", ".join(f"{share * full:g}" for share in steps.shares)
    table.add_row("steps", f"{sizes} N·m around {steps.preload_share * full:g} N·m")
    slowest_s = max(steps.shares) * full / rate
    table.add_row(
        "drive", f"at most {rate:g} N·m/s: the largest step takes {MS_PER_S * slowest_s:.3g} ms"
    )
    table.add_row("series", f"{profile.series()} of {steps.cycles} steps up and down of each size")
    if sines is not None:
        size = sines.share * full
        periods = ", ".join(f"{each:g}" for each in sines.periods_s)
        table.add_row("sines", f"{size:g} N·m, periods {periods} s")
        table.add_row("", f"the drive follows periods from {6.2832 * size / rate:.3g} s")
