"""Calibrate modules at the terminal, and report the results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from torquebench.cli.answers import CALIBRATED_MODULE
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.recovered import tell_doubts
from torquebench.cli.reports import write_reports
from torquebench.cli.terminal.console import (
    answer,
    out,
    say,
    warn,
    write_contradictions,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from torquebench.bench.roles import Side
    from torquebench.calibration import Profile
    from torquebench.campaign.finishing import FinishedCalibration
    from torquebench.campaign.fitting import ModelChoice
    from torquebench.campaign.resuming import InterruptedCalibration
    from torquebench.cli.options import BenchOptions

__all__ = ["report_calibration", "run_calibrations", "write_calibration_reports"]


def run_calibrations(
    description: Any,
    sides: tuple[Side, ...],
    profile: Profile,
    model: ModelChoice | None,
    options: BenchOptions,
    *,
    interrupted: InterruptedCalibration | None = None,
    reports: Sequence[Path] = (),
) -> None:
    """Calibrate modules one after the other, or continue with one, and report each."""
    from torquebench.campaign.doubts import CALIBRATOR
    from torquebench.campaign.finishing import finish_calibration
    from torquebench.campaign.fitting import ModelChoice
    from torquebench.campaign.measuring import measure_calibration
    from torquebench.campaign.registering import registers_calibration
    from torquebench.campaign.resuming import resume_calibration
    from torquebench.cli.models.compiling import second_process
    from torquebench.compensation import RECOMMENDED

    contradicting = False
    active: str | None = RECOMMENDED
    choices = [ModelChoice(RECOMMENDED)]
    if interrupted is not None:
        choices, active = interrupted.choices
    if model is not None:
        choices, active = [model], model.name
    known = registers_calibration(choices, active)
    resumed = interrupted.run_ids[-1] if interrupted else ""
    with (
        second_process(),
        options.open(description, resumed=resumed) as session,
    ):
        station = session.station
        tell_doubts(station, CALIBRATOR)
        for side in sides:
            with session.measuring() as (progress, ask):
                if interrupted is not None:
                    measured = resume_calibration(
                        station, interrupted, metadata=known, progress=progress, on_pause=ask
                    )
                else:
                    measured = measure_calibration(
                        station, side, profile, metadata=known, progress=progress, on_pause=ask
                    )
                finished = finish_calibration(
                    station.registry, measured, profile, choices, active, progress
                )
            report_calibration(finished)
            write_calibration_reports(finished, reports, several=len(sides) > 1)
            contradicting = contradicting or bool(finished.fitted[0].contradictions)
    if contradicting:
        raise typer.Exit(CHECK_FAILED)


def write_calibration_reports(
    finished: FinishedCalibration, reports: Sequence[Path], *, several: bool = False
) -> None:
    """Write a calibration's report; with several modules one file each."""
    if not reports:
        return
    from torquebench.reports.calibration_report import calibration_page

    side = finished.measured.result.data.side
    own = [path.with_stem(f"{path.stem}-{side}") if several else path for path in reports]
    write_reports(calibration_page(finished), own)


def report_calibration(finished: FinishedCalibration) -> None:
    """Print the calibration's results on its own points, which aren't a verification."""
    from torquebench.calibration import summarise_errors
    from torquebench.cli.staircase import placement_table
    from torquebench.cli.tables import error_blocks

    result, fitted = finished.measured.result, finished.fitted[0]
    data = result.data
    torque = fitted.chain.torque(data.readings()).value_nm
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
    if data.loading_accuracy_percent is not None:
        say(f"loaded within {data.loading_accuracy_percent:.2g} % of range of the target torques")
    if result.placement is not None:
        say(result.placement.sentence)
        out().print(placement_table(result.placement))
    entry = finished.registered.models[fitted.name]
    named = f"model-{entry.model_id} of calibration-{entry.calibration_id}"
    if fitted.contradictions:
        write_contradictions(
            fitted.contradictions,
            "find the cause and calibrate again, or override this with a name and a reason: "
            f"torquebench records use model-{entry.model_id} --by NAME --reason WHY",
        )
        say(f"[bold red]Not in use[/bold red]: {named}, which contradicts itself.")
    else:
        use = "In use" if finished.active == fitted.name else "Registered, not put into use"
        say(f"{use}: {named}.")
    say(f"Run: {finished.measured.record.run_id}")
    if result.unsettled:
        warn(f"{result.unsettled} points still drifted at the end of their waiting time")
    for remark in fitted.remarks:
        warn(remark)
    module = CALIBRATED_MODULE.of(
        data,
        points=len(data),
        kind=fitted.name,
        raw=rows[0][1],
        fitted=rows[1][1],
        model=f"model-{entry.model_id}",
        calibration=f"calibration-{entry.calibration_id}",
        in_use=not fitted.contradictions and finished.active == fitted.name,
        run=finished.measured.record.run_id,
        unsettled=result.unsettled,
        contradictions=fitted.contradictions,
    )
    answer(modules=[module])
