"""`torquebench calibrate`: one or both modules against the calibrator, fitted and put into use."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.console import note, out, say, warn, write_contradictions
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    RealTimeOption,
    bench_description,
)
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.drivers.base import Side
    from torquebench.calibration import Profile
    from torquebench.campaign.finishing import FinishedCalibration
    from torquebench.campaign.measuring import Measured
    from torquebench.campaign.resuming import InterruptedCalibration
    from torquebench.cli.progress import TerminalProgress
    from torquebench.procedures import StaircaseResult

__all__ = ["confirm_start", "register", "report_calibration", "run_calibrations"]


class Sides(StrEnum):
    """Which module."""

    input = "input"
    output = "output"
    both = "both"

    @property
    def chosen(self) -> tuple[Side, ...]:
        """The sides, input first."""
        if self is Sides.both:
            return ("input", "output")
        return ("input",) if self is Sides.input else ("output",)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("calibrate")(calibrate)


def calibrate(
    side: Annotated[Sides | None, typer.Argument(help="Which module.", show_default=False)] = None,
    bench: BenchOption = None,
    profile: Annotated[
        str, typer.Option(help="A profile's name, or the path of an own profile (.toml).")
    ] = "rapid-in-situ",
    rising_only: Annotated[
        bool, typer.Option("--rising-only", help="Load rising series only, as the sources do.")
    ] = False,
    repeats: Annotated[
        int | None, typer.Option(min=1, help="How often every series is loaded.")
    ] = None,
    step_percent: Annotated[
        float | None, typer.Option(min=0.1, max=100, help="Width of the steps, % of range.")
    ] = None,
    up_to: Annotated[
        float | None,
        typer.Option(
            metavar="TORQUE",
            help="Largest torque of one module, N·m: the profile's steps and preloads shrink with "
            "it. For a reducer that needs a small part of the range.",
        ),
    ] = None,
    points: Annotated[
        int | None, typer.Option(min=8, help="Most points of an adaptive calibration.")
    ] = None,
    target: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=100,
            help="An adaptive calibration ends with this largest U (k = 2) of the model, % FS.",
        ),
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="Kind of model; without it the recommended one.")
    ] = None,
    data: DataOption = DEFAULT_DATA,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Print the staircase and check it; nothing moves."),
    ] = False,
    resume: Annotated[
        str | None,
        typer.Option(
            metavar="RUN",
            help="Go on with an interrupted calibration: its id, the beginning of it, or `latest`.",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Confirm all questions without asking.")
    ] = False,
    real_time: RealTimeOption = False,
) -> None:
    """Calibrate modules against the calibrator, fit the compensation and put it into use.

    Zero, preload and the profile's staircase, each point a checkpoint: Ctrl-C pauses at the next
    point. Limits and interlocks are checked for the whole sequence before anything moves.
    With --resume module, profile and bench are those of the interrupted run.
    """
    from torquebench.calibration import load_profile

    if resume is not None:
        from torquebench.cli.resume import resume_run

        resume_run(resume, side.chosen if side else (), bench, model, data, real_time, yes)
        return
    if side is None:
        raise InputError("no module to calibrate", "input, output or both", "name it")

    description = bench_description(bench)
    chosen = load_profile(profile).with_options(
        rising_only=rising_only or None,
        repeats=repeats,
        step_percent=step_percent,
        up_to_percent=None if up_to is None else _percent(description, side, up_to),
        points=points,
        target_percent=target,
    )
    if chosen.loading.pattern == "random":
        raise InputError(
            f"profile {chosen.name} for a calibration",
            "a profile of steps",
            "give rapid-in-situ, adaptive, staircase, reversing, small-torques or an own one",
        )
    _check_model(model)
    if dry_run:
        _dry_run(description, side.chosen, chosen)
        return
    confirm_start(description, side.value, chosen, yes)
    run_calibrations(description, side.chosen, chosen, model, data, real_time=real_time, yes=yes)


def _percent(description: BenchDescription, side: Sides, torque_nm: float) -> float:
    """Return a largest torque in % of the range of the one module that it is for."""
    if side is Sides.both:
        raise InputError(
            f"up to {torque_nm:g} N·m at both modules",
            "input or output",
            "calibrate one after the other, each up to what it needs",
        )
    return 100.0 * torque_nm / description.module(side.chosen[0]).range_nm


def _check_model(name: str | None) -> None:
    from torquebench.compensation import check_kind

    if name is not None:
        check_kind(name)


def confirm_start(description: Any, side: str, profile: Profile, yes: bool) -> None:
    """Ask before torque is applied, where somebody is there and the bench is a real one."""
    import sys

    if yes or description.simulated:
        return
    if not sys.stdin.isatty():
        raise InputError(
            f"{description.name} is a real bench and nobody is there to confirm",
            "a person at the terminal, or --yes",
            "check that nobody is at the bench, then give --yes",
        )
    note(
        f"{description.name}: {side} will be loaded to ±{profile.largest_percent:g} % of range "
        f"by {profile.name}."
    )
    if not typer.confirm("Is the bench clear and may it be loaded?"):
        raise typer.Exit(1)


def _dry_run(description: Any, sides: tuple[Side, ...], profile: Profile) -> None:
    """Rehearse the very plans that would run, and print what they would load."""
    import tempfile

    from torquebench.campaign.measuring import rehearse_calibration
    from torquebench.cli.staircase import staircase_tables
    from torquebench.station import Station

    with (
        tempfile.TemporaryDirectory() as scratch,
        Station.open(description, Path(scratch)) as station,
    ):
        for side in sides:
            rehearsal = rehearse_calibration(station, side, profile)
            for part in staircase_tables(description, side, profile, rehearsal):
                out().print(part)
    say("Limits and interlocks checked; nothing was moved.")


def run_calibrations(
    description: Any,
    sides: tuple[Side, ...],
    profile: Profile,
    model: str | None,
    data: Path,
    *,
    real_time: bool,
    yes: bool,
    interrupted: InterruptedCalibration | None = None,
) -> None:
    """Calibrate modules one after the other, or go on with one, and report each."""
    from torquebench.bench.prompts import PromptQueue, QueuedOperator
    from torquebench.campaign.finishing import finish_calibration, registers_calibration
    from torquebench.campaign.fitting import ModelChoice
    from torquebench.campaign.measuring import RunAbortedError, measure_calibration
    from torquebench.campaign.resuming import resume_calibration
    from torquebench.cli.doubts import CALIBRATOR, tell_doubts
    from torquebench.cli.interrupts import BenchInterrupts
    from torquebench.cli.presence import attending
    from torquebench.cli.progress import TerminalProgress
    from torquebench.cli.prompts import answering
    from torquebench.cli.recovered import tell_recovered, tell_warnings
    from torquebench.compensation import RECOMMENDED
    from torquebench.station import Station

    if description.simulated:
        note("simulated bench")
    contradicting = False
    prompts = PromptQueue()
    operator = None if description.simulated else QueuedOperator(prompts)
    kind = model or RECOMMENDED
    known = registers_calibration([kind], kind)
    with Station.open(description, data, real_time=real_time, operator=operator) as station:
        tell_recovered(station, but=interrupted.run_ids[-1] if interrupted else "")
        tell_doubts(station, CALIBRATOR)
        for side in sides:
            progress = TerminalProgress()
            interrupts = BenchInterrupts(station, progress)

            def measure(
                side: Side = side,
                progress: TerminalProgress = progress,
                interrupts: BenchInterrupts = interrupts,
            ) -> Measured[StaircaseResult]:
                ask = interrupts.ask
                if interrupted is not None:
                    return resume_calibration(
                        station, interrupted, metadata=known, progress=progress, on_pause=ask
                    )
                return measure_calibration(
                    station, side, profile, metadata=known, progress=progress, on_pause=ask
                )

            try:
                with (
                    progress,
                    tell_warnings(station, progress),
                    attending(station, progress),
                    interrupts.watching(),
                    answering(prompts, progress, yes=yes),
                ):
                    finished = finish_calibration(
                        station.registry, measure(), profile, [ModelChoice(kind)], kind, progress
                    )
            except RunAbortedError as aborted:
                raise interrupts.reported(aborted) from None
            report_calibration(finished)
            contradicting = contradicting or bool(finished.fitted[0].contradictions)
    if contradicting:
        raise typer.Exit(CHECK_FAILED)


def report_calibration(finished: FinishedCalibration) -> None:
    """Print what the calibration found, on its own points: that is no verification."""
    from torquebench.calibration import summarise_errors
    from torquebench.campaign.fitting import feature_columns
    from torquebench.cli.staircase import placement_table
    from torquebench.cli.tables import error_blocks

    result, fitted = finished.measured.result, finished.fitted[0]
    data, model = result.data, fitted.model
    torque = model.predict(data.features(feature_columns(model)))
    simulated = " - simulated" if data.simulated else ""
    say(
        f"[bold]{data.side.capitalize()} module, {data.range_nm:g} N·m, "
        f"transducer {data.transducer_serial}{simulated}[/bold]"
    )
    rows = [
        ("raw reading", summarise_errors(data.reading_nm, data.standard_nm, data.range_nm)),
        (f"*{fitted.title}", summarise_errors(torque, data.standard_nm, data.range_nm)),
    ]
    title = f"{len(data)} points that it was fitted to, against the standard"
    for part in error_blocks([(title, rows)]):
        out().print(part)
    if result.placement is not None:
        say(result.placement.sentence)
        out().print(placement_table(result.placement))
    entry = finished.registered.models[fitted.name]
    named = f"model-{entry.model_id} of calibration-{entry.calibration_id}"
    if fitted.contradictions:
        write_contradictions(
            fitted.contradictions,
            "find the cause and calibrate again, or decide otherwise on the record: "
            f"torquebench records use model-{entry.model_id} --by NAME --reason WHY",
        )
        say(f"[bold red]Not in use[/bold red]: {named}, which contradicts itself.")
    else:
        use = "In use" if finished.active == fitted.name else "Registered, not put into use"
        say(f"{use}: {named}.")
    say(f"Run: {finished.measured.record.run_id}")
    if result.unsettled:
        warn(f"{result.unsettled} points still drifted when their waiting time was over")
    for remark in fitted.remarks:
        warn(remark)
