"""`torquebench calibrate`: calibrate modules against the calibrator, fit and activate models."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.answers import PLAN
from torquebench.cli.calibrating import run_calibrations
from torquebench.cli.models.parameters import ParameterOption, model_parameters
from torquebench.cli.mounting import MountingOption, mounting_record, recorded
from torquebench.cli.options import BenchOptions
from torquebench.cli.reports import check_reports
from torquebench.cli.resume import resume_run
from torquebench.cli.terminal.confirming import confirm_start
from torquebench.cli.terminal.console import answer, out
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.drivers.base import Side
    from torquebench.calibration import Profile
    from torquebench.campaign.fitting import ModelChoice

__all__ = ["calibrate"]


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


def calibrate(
    side: Annotated[Sides | None, typer.Argument(help="Which module.", show_default=False)] = None,
    profile: Annotated[
        str, typer.Option(help="A profile's name, or the path of a .toml file.")
    ] = "rapid-in-situ",
    rising_only: Annotated[
        bool,
        typer.Option("--rising-only", help="Load rising series only, as in the source papers."),
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
            help="Largest torque of one module, N·m: the profile's steps and preloads scale with "
            "it. For a reducer that needs a small part of the range.",
        ),
    ] = None,
    points: Annotated[
        int | None, typer.Option(min=8, help="Largest number of points of an adaptive calibration.")
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
    parameter: ParameterOption = None,
    mounting: MountingOption = None,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Print the staircase and check it; nothing moves."),
    ] = False,
    resume: Annotated[
        str | None,
        typer.Option(
            metavar="RUN",
            help="Resume an interrupted calibration: its id, the beginning of the id, or `latest`.",
        ),
    ] = None,
    report: Annotated[
        list[Path] | None,
        typer.Option(
            "--report",
            help="Write a report with figures (.html or .pdf), one "
            "for each module. May be repeated.",
        ),
    ] = None,
    *,
    options: BenchOptions,
) -> None:
    """Calibrate modules against the calibrator, fit the compensation and put it into use.

    Zero, preload and the profile's staircase, each point a checkpoint: Ctrl-C pauses at the next
    point. Limits and interlocks are checked for the whole sequence before anything moves.
    With --resume module, profile and bench are those of the interrupted run.
    """
    from torquebench.calibration import check_steps, load_profile

    if resume is not None:
        check_reports(report)
        with recorded(mounting_record(mounting)):
            choice = _choice(model, parameter)
            resume_run(resume, side.chosen if side else (), choice, options, report or ())
        return
    if side is None:
        raise InputError("no module to calibrate", "input, output or both", "name it")

    description = options.description()
    chosen = load_profile(profile).with_options(
        rising_only=rising_only or None,
        repeats=repeats,
        step_percent=step_percent,
        up_to_percent=None if up_to is None else _percent(description, side, up_to),
        points=points,
        target_percent=target,
    )
    check_steps(chosen)
    choice, found = _choice(model, parameter), mounting_record(mounting)
    check_reports(report)
    if dry_run:
        _dry_run(description, side.chosen, chosen)
        return
    confirm_start(description, side.value, chosen, options.yes)
    with recorded(found):
        run_calibrations(
            description,
            side.chosen,
            chosen,
            choice,
            options,
            reports=report or (),
        )


def _percent(description: BenchDescription, side: Sides, torque_nm: float) -> float:
    """Return the largest torque in % of the range of the one module to which it applies."""
    if side is Sides.both:
        raise InputError(
            Message("up to {torque_nm:g} N·m at both modules", torque_nm),
            "input or output",
            "calibrate one module after the other, each up to its own torque",
        )
    return 100.0 * torque_nm / description.module(side.chosen[0]).range_nm


def _choice(name: str | None, parameters: list[str] | None) -> ModelChoice | None:
    from torquebench.compensation import check_kind

    if name is None and parameters:
        raise InputError("--parameter without --model", "both", "name the kind of model as well")
    if name is None:
        return None
    check_kind(name)
    from torquebench.campaign.fitting import ModelChoice

    return ModelChoice(name, model_parameters(name, parameters))


def _dry_run(description: Any, sides: tuple[Side, ...], profile: Profile) -> None:
    """Rehearse the same plans as the real run, and print what they would load."""
    from torquebench.campaign.measuring import rehearse_calibration, standard_at_rest
    from torquebench.cli.bench_session import rehearsing
    from torquebench.cli.staircase import staircase_tables

    with rehearsing(description) as station:
        for side in sides:
            standard_at_rest(station, side, "calibrator")  # where it is mounted already
            rehearsal = rehearse_calibration(station, side, profile)
            for part in staircase_tables(description, side, profile, rehearsal):
                out().print(part)
            answer(plans=[PLAN.of(rehearsal, side=side)])
