"""Runs of a turning module, from profile to table: empty runs, calibrations, verifications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.campaign.bench_chains import referenced
from torquebench.campaign.measuring import Measured, RunKind, RunOptions, run_only
from torquebench.dynamics import MotorInertia
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures import Plan, Rehearsal, rehearse
from torquebench.procedures.turning.calibrating import calibrate_turning
from torquebench.procedures.turning.empty import EmptySummary, EmptyTable, SeriesTable, turn_empty
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.procedures.turning.stepping import StepTable, step_torques
from torquebench.progress import Progress
from torquebench.records import Registry
from torquebench.station import Station
from torquebench.tables import read_calibration, read_table, write_calibration
from torquebench.units import MINUTE

COLUMNS = ("time_s", "reading_nm", "speed_rpm", "temperature_c")
ANGLE = "angle_deg"
"""Additional column, if the encoder counts from a mark."""
_RESUMED_AFTER_S = 60.0
"""Assumed time between the last row of an interrupted run and the next row, because the real time
is unknown.
"""


@dataclass(frozen=True)
class BegunCalibration:
    """Complete series of an interrupted turning calibration."""

    points: CalibrationData
    series_done: int


@dataclass(frozen=True)
class TurningRun:
    """A finished run and its table, which also has the rows of an interrupted run before it."""

    run_id: str
    table: Path
    rows: int
    bench_seconds: float


TABLE = "turning_table"
"""Key of a run's metadata with the path of its table."""


def _evaluate(_registry: Registry, measured: Measured[Any], _progress: Progress) -> TurningRun:
    """Count the rows of the table that the run wrote."""
    record, table = measured.record, Path(measured.record.metadata[TABLE])
    return TurningRun(record.run_id, table, len(read_table(table)), record.bench_seconds)


def describe_turning(run: TurningRun) -> Message:
    """Return the number of rows, the duration and the table of a run in a sentence."""
    return Message(
        "{rows} rows in {minutes:.3g} min of bench time: {path}",
        run.rows,
        run.bench_seconds / MINUTE,
        run.table,
    )


EMPTY_RUN = RunKind(
    "empty-run-{side}",
    lambda side: Message("Empty run of the {side} module", side),
    turn_empty,
    _evaluate,
    run_only,
    describe_turning,
)
DYNAMICS = RunKind(
    "dynamics-{side}",
    lambda side: Message("Dynamics of the {side} module", side),
    step_torques,
    _evaluate,
    run_only,
    describe_turning,
)
CALIBRATION, VERIFICATION = (
    RunKind(
        f"turning-{kind}-{{side}}",
        partial(Message, "Turning {kind} of the {side} module", kind),
        calibrate_turning,
        _evaluate,
        run_only,
        describe_turning,
    )
    for kind in ("calibration", "verification")
)


def rehearse_turning(
    station: Station, side: Side, profile: TurningProfile
) -> Rehearsal[EmptySummary] | Rehearsal[CalibrationData] | Rehearsal[StepTable]:
    """Rehearse a run; its duration excludes waiting times."""
    return rehearse(station.devices, _without_table(station, side, profile))


def _without_table(station: Station, side: Side, profile: TurningProfile) -> Plan[Any]:
    """Return the plan of a whole run, without writing its table."""
    if profile.kind == "dynamics":
        return step_torques(station.devices, side, profile, StepTable())
    if profile.kind != "empty":
        return calibrate_turning(station.devices, side, profile)
    return turn_empty(station.devices, side, profile, EmptyTable(side))


def measure_turning(
    station: Station,
    side: Side,
    profile: TurningProfile,
    target: Path,
    *,
    begun: EmptyTable | BegunCalibration | StepTable | None = None,
    wait: bool = True,
    **options: Unpack[RunOptions],
) -> TurningRun:
    """Run a profile and write its table after every complete series.

    Parameters
    ----------
    side : {"input", "output"}
    target : pathlib.Path
        CSV file.
    begun : EmptyTable, BegunCalibration or StepTable, optional
        Table of an interrupted run, from `read_begun`.
    wait : bool
        Whether series wait for their temperature.
    **options
        See `RunOptions`.

    Raises
    ------
    LimitError, InterlockError
        The run is refused before anything moves.
    RunAbortedError
        Somebody ended the run; complete series are in the file.
    """
    options["metadata"] = {TABLE: str(target.absolute()), **options.get("metadata", {})}
    if profile.kind == "dynamics" and (begun is None or isinstance(begun, StepTable)):
        return _measure_steps(station, side, profile, target, begun or StepTable(), options)
    if profile.kind == "empty" and (begun is None or isinstance(begun, EmptyTable)):
        table = begun or EmptyTable(side)
        return _measure_empty(station, side, profile, target, table, wait, options)
    if profile.kind in ("calibration", "verification") and (
        begun is None or isinstance(begun, BegunCalibration)
    ):
        return _measure_points(station, side, profile, target, begun, wait, options)
    raise InputError(Message("profile {name}", profile.name), "the profile of the interrupted run")


def _measure_points(
    station: Station,
    side: Side,
    profile: TurningProfile,
    target: Path,
    begun: BegunCalibration | None,
    wait: bool,
    options: RunOptions,
) -> TurningRun:
    """Measure torques against a rotating reference, after the series of an interrupted run."""
    done = 0 if begun is None else begun.series_done
    shift_s = 0.0
    if begun is not None and begun.points.time_s is not None:
        last_s = float(begun.points.time_s[-1])
        shift_s = last_s + _RESUMED_AFTER_S - station.clock.now()

    def write(points: CalibrationData, series_done: int) -> None:
        """Write the points so far, after those of an interrupted run."""
        if begun is not None:
            assert points.time_s is not None
            later = replace(points, time_s=points.time_s + shift_s)
            points = replace(
                CalibrationData.concatenate([begun.points, later]),
                series=np.concatenate([begun.points.series, points.series]),
            )
        remarks = _remarks(station, side, profile, series_done)
        stated = referenced(points, {"bench": station.description})
        write_calibration(target, stated, remarks)

    def rest_of_run() -> Plan[CalibrationData]:
        return calibrate_turning(station.devices, side, profile, wait=wait, series_done=done)

    kind = CALIBRATION if profile.kind == "calibration" else VERIFICATION
    settings = {"wait": wait, "series_done": done, "on_series": write}
    measured = kind.measure(
        station, side, profile, settings=settings, rehearsed=rest_of_run, **options
    )
    return kind.evaluate_and_register(station.registry, measured)


def _measure_empty(
    station: Station,
    side: Side,
    profile: TurningProfile,
    target: Path,
    table: EmptyTable,
    wait: bool,
    options: RunOptions,
) -> TurningRun:
    """Turn the module with nothing mounted; the table is written after every complete series."""

    def write(done: EmptyTable) -> None:
        _write(target, done, station, profile)

    _follow_on(table, station)
    measured = EMPTY_RUN.measure(
        station,
        side,
        profile,
        table,
        settings={"wait": wait, "on_series": write},
        rehearsed=lambda: _without_table(station, side, profile),
        **options,
    )
    return EMPTY_RUN.evaluate_and_register(station.registry, measured)


def _follow_on(table: SeriesTable, station: Station) -> None:
    """Shift the times of a resumed run, so that its rows follow the earlier ones."""
    if len(table.rows):
        table.shift_s = table.rows[-1, 0] + _RESUMED_AFTER_S - station.clock.now()


def _measure_steps(
    station: Station,
    side: Side,
    profile: TurningProfile,
    target: Path,
    table: StepTable,
    options: RunOptions,
) -> TurningRun:
    """Run steps and sines of torque; the table is written after every complete series."""
    module, standard = station.description.module(side), station.description.calibrator
    remarks = {"reference_delay_s": f"{standard.transducer(side).group_delay_s:.6g}"}
    if module.motor_inertia_kgm2 is not None:
        motor = MotorInertia.stated(
            module.motor_inertia_kgm2, module.motor_inertia_uncertainty_percent
        )
        remarks["motor_inertia_kgm2"] = f"{motor.inertia_kgm2:.6g}"
        u = motor.standard_uncertainty_kgm2
        remarks["motor_inertia_standard_uncertainty_kgm2"] = f"{u:.6g}"
    _follow_on(table, station)

    def write(done: StepTable) -> None:
        """Write the table of the series so far."""
        stated = {**_remarks(station, side, profile, done.series_done), **remarks}
        rows = [
            f"{time_s:.6f},{reading_nm:.7g},{standard_nm:.7g},{segment:.0f},{period_s:g}"
            for time_s, reading_nm, standard_nm, segment, period_s in done.rows.tolist()
        ]
        _write_table(target, stated, StepTable.COLUMNS, rows)

    measured = DYNAMICS.measure(
        station,
        side,
        profile,
        table,
        settings={"on_series": write},
        rehearsed=lambda: _without_table(station, side, profile),
        **options,
    )
    return DYNAMICS.evaluate_and_register(station.registry, measured)


def _remarks(
    station: Station, side: Side, profile: TurningProfile, series_done: int
) -> dict[str, str]:
    """Return the remarks in a table's file that identify its run and its completed series."""
    module = station.description.module(side)
    series = profile.series()
    if profile.kind in ("calibration", "verification"):
        series = profile.points(side, module.range_nm)[-1].series
    return {
        "simulated": str(station.devices.context.drivers.truth is not None).lower(),
        "side": side,
        "range_nm": f"{module.range_nm:g}",
        "transducer_serial": module.transducer.serial,
        "profile": profile.name,
        "profile_hash": profile.sha256,
        "series_done": f"{series_done} of {series}",
    }


def _write(target: Path, table: EmptyTable, station: Station, profile: TurningProfile) -> None:
    """Write an empty run's table with its circumstances as remarks."""
    scale = station.description.module(table.side).transducer.scale()
    remarks = {
        **_remarks(station, table.side, profile, table.series_done),
        "zero": repr(table.zero),
        "zero_uncertainty_nm": repr(table.zero_uncertainty_nm),
        "zero_nm": f"{scale.torque(table.zero):.9g}",
    }
    absolute = station.description.needed_encoder(table.side).absolute
    by_angle = absolute and bool(np.isfinite(table.rows[:, -1]).all())
    rows = [
        f"{time_s:.6f},{reading_nm:.7g},{speed_rpm:.7g},{temperature_c:.6g}"
        + (f",{angle_deg:.3f}" if by_angle else "")
        for time_s, reading_nm, speed_rpm, temperature_c, angle_deg in table.rows.tolist()
    ]
    _write_table(target, remarks, (*COLUMNS, ANGLE) if by_angle else COLUMNS, rows)


def _write_table(
    target: Path, remarks: Mapping[str, str], columns: Sequence[str], rows: Sequence[str]
) -> None:
    """Write a table with its remarks; an error leaves the file as it was."""
    lines = [f"# {name} = {value}" for name, value in remarks.items()]
    atomic_write(target, "\n".join([*lines, ",".join(columns), *rows]) + "\n")


def read_begun(
    path: Path, side: Side, profile: TurningProfile, transducer_serial: str
) -> EmptyTable | BegunCalibration | StepTable:
    """Return the complete series of an interrupted run.

    Raises
    ------
    InputError
        Where the file is of another profile, side or transducer, or is complete.
    """
    table = read_table(path)
    wanted = {
        "side": side,
        "profile_hash": profile.sha256,
        "transducer_serial": transducer_serial,
    }
    for name, value in wanted.items():
        if table.remarks.get(name) != value:
            raise InputError(
                Message(
                    "{path}: {name} = {remarks}", path, name, table.remarks.get(name, "missing")
                ),
                Message("{value}, to resume this run", value),
                "give the side and the profile of the interrupted run",
            )
    done, _, total = table.remarks.get("series_done", "0 of 1").partition(" of ")
    if int(done) >= int(total):
        raise InputError(
            Message("{path} is complete", path), "an interrupted run", "begin another file"
        )
    if profile.kind == "dynamics":
        steps = StepTable()
        kept = [table.numbers(name) for name in StepTable.COLUMNS]
        steps.begin_with(np.column_stack(kept), int(done))
        return steps
    if profile.kind != "empty":
        return BegunCalibration(read_calibration(path), int(done))
    rows: NDArray[np.float64] = np.column_stack(
        [table.numbers(name) for name in COLUMNS]
        + [table.numbers(ANGLE) if ANGLE in table else np.full(len(table), np.nan)]
    )
    begun = EmptyTable(side)
    begun.begin_with(rows, int(done))
    begun.zero, begun.zero_uncertainty_nm = (
        float(table.remarks.get(name, "nan")) for name in ("zero", "zero_uncertainty_nm")
    )
    return begun
