"""`torquebench evaluate hysteresis|friction|…`: reducer tests of other benches."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.reducers.columns import Kind, read_columns
from torquebench.cli.reducers.tables import present
from torquebench.cli.reports import ReportOption, check_reports, write_reports
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import ARCMIN, ARCSEC

if TYPE_CHECKING:
    from torquebench.reducers import (
        FrictionResult,
        QuantityVerdict,
        ReducerDescription,
        ReducerResult,
    )

__all__ = ["breakaway", "efficiency", "friction", "hysteresis", "no_load", "transmission_error"]

DataArgument = Annotated[Path, typer.Argument(help="A table with a header (CSV, Excel, TDMS, …).")]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        help="Assigns a header to a quantity: NAME=Header[unit]; a minus sign before the header "
        "reverses the sign. May be repeated.",
    ),
]
WhereOption = Annotated[
    list[str] | None,
    typer.Option("--where", help="Use only rows with Header=value,value. May be repeated."),
]
ReducerOption = Annotated[
    str | None,
    typer.Option("--reducer", help="Its description: a .toml file, or a packaged type's name."),
]
OutputOption = Annotated[
    Path | None, typer.Option("--output", help="A folder for every number and the curves.")
]
RatioOption = Annotated[
    float | None,
    typer.Option(help="Input revolutions per output revolution; negative if the output reverses."),
]
TorqueOption = Annotated[
    float, typer.Option(min=0, help="Standard uncertainty of the torque, % of reading.")
]
ZeroOption = Annotated[float, typer.Option(min=0, help="Standard uncertainty of the zero, N·m.")]
ShareOption = Annotated[
    float | None,
    typer.Option("--largest-uncertainty", min=0, help="Refuse U above this share of the value, %."),
]


class Rule(StrEnum):
    """Lost motion rules."""

    nabtesco = "nabtesco"
    spinea = "spinea"
    harmonic_drive = "harmonic-drive"
    yaskawa = "yaskawa"


class Kinds(StrEnum):
    """Break-away torques."""

    starting = "starting"
    back_driving = "back-driving"


def _described(name: str | None) -> ReducerDescription | None:
    from torquebench.reducers import load_reducer

    return None if name is None else load_reducer(name)


def _ratio(ratio: float | None, described: ReducerDescription | None) -> float:
    if ratio is not None:
        return ratio
    if described is None:
        raise InputError("no ratio", "--ratio, or --reducer with a description that contains it")
    return described.signed_ratio


def _finish(
    test: str,
    data: Path,
    result: ReducerResult | FrictionResult,
    described: ReducerDescription | None,
    output: Path | None,
    report: list[Path] | None,
    **settings: Any,
) -> None:
    from torquebench.reducers import FrictionResult, verdicts

    judged: tuple[QuantityVerdict, ...] = ()
    if described is not None and not isinstance(result, FrictionResult):
        judged = verdicts(result, described)
    settings["reducer"] = None if described is None else described.model_dump(mode="json")
    if report:
        from torquebench.reports.evaluation_report import evaluation_page

        write_reports(evaluation_page(test, data.name, result, judged, described), report)
    present(test, data, result, judged, output, settings)


def hysteresis(
    data: DataArgument,
    rated_torque: Annotated[
        float | None, typer.Option(min=0, help="Rated torque at the output, N·m.")
    ] = None,
    reducer: ReducerOption = None,
    column: ColumnOption = None,
    where: WhereOption = None,
    rule: Annotated[Rule | None, typer.Option(help="Definition of lost motion.")] = None,
    interval: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Interval of the stiffness, % of the rated torque."),
    ] = None,
    regions: Annotated[
        tuple[float, float] | None, typer.Option(help="T1 and T2 of three regions, N·m.")
    ] = None,
    settling_loops: Annotated[
        int, typer.Option(min=0, help="Loops left out at the start of each position.")
    ] = 0,
    closure: Annotated[
        float, typer.Option(min=0, max=100, help="Gap that counts as closed, % of the width.")
    ] = 5.0,
    bench_compliance: Annotated[
        float, typer.Option(min=0, help="Twist of the bench, arcmin per N·m.")
    ] = 0.0,
    compliance_uncertainty: Annotated[
        float, typer.Option(min=0, help="Its standard uncertainty, arcmin per N·m.")
    ] = 0.0,
    flange_inertia: Annotated[
        float | None,
        typer.Option(min=0, help="Moment of inertia between transducer and reducer, kg·m²."),
    ] = None,
    inertia_uncertainty: Annotated[
        float, typer.Option(min=0, help="Its expanded uncertainty (k = 2), %.")
    ] = 10.0,
    torque_uncertainty: TorqueOption = 0.0,
    zero_uncertainty: ZeroOption = 0.0,
    branch_uncertainty: Annotated[
        float, typer.Option(min=0, help="Standard uncertainty between the branches, N·m.")
    ] = 0.0,
    angle_uncertainty: Annotated[
        float, typer.Option(min=0, help="Standard uncertainty of an angle, arcsec.")
    ] = 0.0,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate torque-angle loops: stiffness, backlash, lost motion, hysteresis loss.

    Columns: torque and angle; optionally position (label of the output position), loop (its number)
    and demanded (requested torque); time if the inertia of a flange is given. Input locked, load at
    the output.
    """
    check_reports(report)
    described = _described(reducer)
    if rated_torque is None and described is None:
        raise InputError("no rated torque", "--rated-torque, or --reducer")
    kinds: dict[str, Kind] = {
        "torque": "torque",
        "angle": "angle",
        "position": "label",
        "loop": "label",
        "demanded": "torque",
    }
    needed: tuple[str, ...] = ("torque", "angle")
    if flange_inertia is not None:
        kinds["time"], needed = "time", (*needed, "time")
    table = read_columns(data, kinds, needed, column or (), where or ())

    from torquebench.reducers import (
        FlangeInertia,
        LoopSettings,
        LoopUncertainty,
        OpenLoopError,
        evaluate_hysteresis,
    )

    flange = None
    if flange_inertia is not None:
        flange = FlangeInertia(flange_inertia, inertia_uncertainty)
    share = None if interval is None else (interval[0] / 100.0, interval[1] / 100.0)
    settings = LoopSettings(
        rated_torque_nm=rated_torque or (described.rated_torque_nm if described else 0.0),
        rule=str(rule or (described.lost_motion_rule if described else "nabtesco")),
        stiffness_interval=share or (described.stiffness_interval if described else (0.5, 1.0)),
        region_torques_nm=regions or (described.region_torques_nm if described else None),
        settling_loops=settling_loops,
        closure_share=closure / 100.0,
    )
    try:
        result = evaluate_hysteresis(
            table["torque"],
            table["angle"],
            settings,
            position=table.get("position"),
            loop=table.get("loop"),
            demanded_nm=table.get("demanded"),
            bench_compliance_rad_per_nm=bench_compliance * ARCMIN,
            time_s=table.get("time"),
            flange=flange,
            uncertainty=LoopUncertainty(
                torque_relative=torque_uncertainty / 100.0,
                torque_zero_nm=zero_uncertainty,
                torque_branch_nm=branch_uncertainty,
                angle_rad=angle_uncertainty * ARCSEC,
                bench_compliance_rad_per_nm=compliance_uncertainty * ARCMIN,
            ),
        )
    except OpenLoopError as problem:
        if report:
            from torquebench.reports.evaluation_report import open_loop_page

            write_reports(open_loop_page(data.name, problem.loop, str(problem)), report)
            raise
        remedy = Message("{remedy}; --report draws the gap", problem.remedy)
        raise InputError(problem.found, problem.allowed, remedy) from None
    _finish("hysteresis", data, result, described, output, report, loop=settings, flange=flange)


def friction(
    data: DataArgument,
    column: ColumnOption = None,
    where: WhereOption = None,
    form: Annotated[
        str, typer.Option(help="best, or the parts: coulomb, coulomb-viscous, ….")
    ] = "best",
    exponent: Annotated[int, typer.Option(min=1, max=2, help="Of the Stribeck part.")] = 2,
    tolerance: Annotated[
        float | None, typer.Option(min=0, help="Largest gap between points of one speed, rpm.")
    ] = None,
    zero_uncertainty: ZeroOption = 0.0,
    largest_uncertainty: ShareOption = None,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate friction over speed: Coulomb, viscous and Stribeck parts, each direction.

    Columns: speed and torque, both clockwise positive; optionally branch (1 rising, -1 falling
    speed), temperature and demanded (requested speed).
    """
    check_reports(report)
    kinds: dict[str, Kind] = {
        "speed": "speed",
        "torque": "torque",
        "branch": "label",
        "temperature": "temperature",
        "demanded": "speed",
    }
    table = read_columns(data, kinds, ("speed", "torque"), column or (), where or ())

    from torquebench.reducers import evaluate_friction

    result = evaluate_friction(
        table["speed"],
        table["torque"],
        table.get("branch"),
        systematic_uncertainty_nm=zero_uncertainty,
        exponent=1 if exponent == 1 else 2,
        form=form,  # type: ignore[arg-type] # checked by evaluate_friction
        tolerance_rpm=tolerance,
        temperature_c=table.get("temperature"),
        demanded_rpm=table.get("demanded"),
    )
    if largest_uncertainty is not None:
        result.require(largest_uncertainty / 100.0)
    _finish("friction", data, result, None, output, report, form=form, exponent=exponent)


def no_load(
    data: DataArgument,
    reducer: ReducerOption = None,
    column: ColumnOption = None,
    where: WhereOption = None,
    tolerance: Annotated[
        float | None, typer.Option(min=0, help="Largest gap between points of one speed, rpm.")
    ] = None,
    reference_temperature: Annotated[
        float | None, typer.Option(help="Bring torques to this temperature, °C.")
    ] = None,
    torque_uncertainty: TorqueOption = 0.0,
    zero_uncertainty: ZeroOption = 0.0,
    largest_uncertainty: ShareOption = None,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate no-load running torque at each speed, with the parts of friction.

    Columns: speed and torque at the input, both clockwise positive; optionally repeat, branch (1
    rising, -1 falling speed), temperature and demanded (requested speed, which groups the points).
    """
    check_reports(report)
    described = _described(reducer)
    kinds: dict[str, Kind] = {
        "speed": "speed",
        "torque": "torque",
        "repeat": "label",
        "branch": "label",
        "temperature": "temperature",
        "demanded": "speed",
    }
    table = read_columns(data, kinds, ("speed", "torque"), column or (), where or ())

    from torquebench.reducers import TorqueUncertainty, evaluate_no_load

    result = evaluate_no_load(
        table["speed"],
        table["torque"],
        nominal_rpm=table.get("demanded"),
        repeat=table.get("repeat"),
        branch=table.get("branch"),
        temperature_c=table.get("temperature"),
        uncertainty=TorqueUncertainty(torque_uncertainty / 100.0, zero_uncertainty),
        tolerance_rpm=tolerance,
        reference_temperature_c=reference_temperature,
        largest_share=None if largest_uncertainty is None else largest_uncertainty / 100.0,
    )
    _finish("no-load", data, result, described, output, report)


def breakaway(
    data: DataArgument,
    kind: Annotated[Kinds, typer.Option(help="Driven from the input, or the output.")],
    reducer: ReducerOption = None,
    column: ColumnOption = None,
    where: WhereOption = None,
    presliding: Annotated[
        float, typer.Option(min=0, help="Elastic motion before break-away, arcmin.")
    ] = 0.0,
    torque_uncertainty: TorqueOption = 0.0,
    zero_uncertainty: ZeroOption = 0.0,
    largest_uncertainty: ShareOption = None,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate starting or back-driving torque: the torque at the first motion of each ramp.

    Columns: time, angle and torque of the driven side; optionally run (number of the ramp) and
    position.
    """
    check_reports(report)
    described = _described(reducer)
    kinds: dict[str, Kind] = {
        "time": "time",
        "angle": "angle",
        "torque": "torque",
        "run": "label",
        "position": "label",
    }
    table = read_columns(data, kinds, ("time", "angle", "torque"), column or (), where or ())

    from torquebench.reducers import TorqueUncertainty, evaluate_breakaway

    result = evaluate_breakaway(
        table["time"],
        table["angle"],
        table["torque"],
        kind="starting" if kind is Kinds.starting else "back-driving",
        run=table.get("run"),
        position=table.get("position"),
        uncertainty=TorqueUncertainty(torque_uncertainty / 100.0, zero_uncertainty),
        presliding_rad=presliding * ARCMIN,
        largest_share=None if largest_uncertainty is None else largest_uncertainty / 100.0,
    )
    _finish(f"{kind} torque", data, result, described, output, report)


def transmission_error(
    data: DataArgument,
    ratio: RatioOption = None,
    reducer: ReducerOption = None,
    column: ColumnOption = None,
    where: WhereOption = None,
    highest_order: Annotated[
        float | None,
        typer.Option(min=1, help="Per output revolution; three times the ratio by default."),
    ] = None,
    wrapped: Annotated[
        bool, typer.Option("--wrapped", help="Both angles start again after each revolution.")
    ] = False,
    output_uncertainty: Annotated[
        float, typer.Option(min=0, help="Standard uncertainty of the output encoder, arcsec.")
    ] = 0.0,
    input_uncertainty: Annotated[
        float, typer.Option(min=0, help="Standard uncertainty of the input encoder, arcsec.")
    ] = 0.0,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate transmission error over output revolutions: peak to peak and orders.

    Columns: input and output (angles of both encoders at the same moments), optionally time. Both
    directions may follow each other.
    """
    check_reports(report)
    described = _described(reducer)
    kinds: dict[str, Kind] = {"input": "angle", "output": "angle", "time": "time"}
    table = read_columns(data, kinds, ("input", "output"), column or (), where or ())

    import numpy as np

    from torquebench.reducers import AngleUncertainty, evaluate_transmission_error

    given, taken = table["input"], table["output"]
    if wrapped:
        given, taken = np.unwrap(given), np.unwrap(taken)
    order = highest_order or (described.highest_error_order if described else None)
    result = evaluate_transmission_error(
        given,
        taken,
        _ratio(ratio, described),
        time_s=table.get("time"),
        highest_order=order,
        uncertainty=AngleUncertainty(output_uncertainty * ARCSEC, input_uncertainty * ARCSEC),
    )
    _finish("transmission error", data, result, described, output, report, highest_order=order)


def efficiency(
    data: DataArgument,
    ratio: RatioOption = None,
    reducer: ReducerOption = None,
    column: ColumnOption = None,
    where: WhereOption = None,
    input_uncertainty: TorqueOption = 0.0,
    input_zero: ZeroOption = 0.0,
    output_uncertainty: TorqueOption = 0.0,
    output_zero: ZeroOption = 0.0,
    largest_uncertainty: ShareOption = None,
    output: OutputOption = None,
    report: ReportOption = None,
) -> None:
    """Evaluate efficiency over torque and speed from steady points.

    Columns: input_torque and output_torque (the torque on the load), speed of the input, all
    clockwise positive; optionally temperature.
    """
    check_reports(report)
    described = _described(reducer)
    kinds: dict[str, Kind] = {
        "input_torque": "torque",
        "output_torque": "torque",
        "speed": "speed",
        "temperature": "temperature",
    }
    required = ("input_torque", "output_torque", "speed")
    table = read_columns(data, kinds, required, column or (), where or ())

    from torquebench.reducers import TorqueUncertainty, evaluate_efficiency

    result = evaluate_efficiency(
        table["input_torque"],
        table["output_torque"],
        table["speed"],
        _ratio(ratio, described),
        temperature_c=table.get("temperature"),
        input_uncertainty=TorqueUncertainty(input_uncertainty / 100.0, input_zero),
        output_uncertainty=TorqueUncertainty(output_uncertainty / 100.0, output_zero),
        largest_share=None if largest_uncertainty is None else largest_uncertainty / 100.0,
    )
    _finish("efficiency", data, result, described, output, report)
