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
from torquebench.campaign.measuring import RunKind, RunOptions
from torquebench.dynamics import MotorInertia
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures import Plan, Rehearsal, rehearse
from torquebench.procedures.turning.calibrating import calibrate_turning
from torquebench.procedures.turning.empty import EmptySummary, EmptyTable, SeriesTable, turn_empty
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.procedures.turning.stepping import StepTable, step_torques
from torquebench.station import Station
from torquebench.tables import read_calibration, read_table, write_calibration

COLUMNS = ("time_s", "reading_nm", "speed_rpm", "temperature_c")
ANGLE = "angle_deg"
"""Additional column, if the encoder counts from a mark."""
_RESUMED_AFTER_S = 60.0
"""Assumed time between the last row of an interrupted run and the next row, because the real time
is unknown.
"""


EMPTY_RUN = RunKind[EmptySummary, None, None](
    "empty-run-{side}", lambda side: Message("Empty run of the {side} module", side), turn_empty
)
DYNAMICS = RunKind[StepTable, None, None](
    "dynamics-{side}", lambda side: Message("Dynamics of the {side} module", side), step_torques
)
CALIBRATION, VERIFICATION = (
    RunKind[CalibrationData, None, None](
        f"turning-{kind}-{{side}}",
        partial(Message, "Turning {kind} of the {side} module", kind),
        calibrate_turning,
    )
    for kind in ("calibration", "verification")
)
"""Runs whose results are tables: only the runs themselves are registered."""


@dataclass(frozen=True)
class BegunCalibration:
    """Complete series of an interrupted turning calibration."""

    points: CalibrationData
    series_done: int


@dataclass(frozen=True)
class TurningRun:
    """A finished run.

    Parameters
    ----------
    rows : int
        Number of rows in the table.
    """

    run_id: str
    rows: int
    bench_seconds: float


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
    if profile.kind == "dynamics":
        if isinstance(begun, EmptyTable | BegunCalibration):
            raise InputError(
                Message("profile {name}", profile.name), "the profile of the interrupted run"
            )
        return _measure_steps(
            station, side, profile, target, StepTable() if begun is None else begun, options
        )
    if profile.kind != "empty":
        before = begun if isinstance(begun, BegunCalibration) else None
        done = 0 if before is None else before.series_done
        shift_s = 0.0
        if before is not None and before.points.time_s is not None:
            last_s = float(before.points.time_s[-1])
            shift_s = last_s + _RESUMED_AFTER_S - station.clock.now()

        def keep(points: CalibrationData, series_done: int) -> None:
            """Store the points so far, after those of an interrupted run."""
            if before is not None:
                assert points.time_s is not None
                later = replace(points, time_s=points.time_s + shift_s)
                points = replace(
                    CalibrationData.concatenate([before.points, later]),
                    series=np.concatenate([before.points.series, points.series]),
                )
            remarks = _remarks(station, side, profile, series_done)
            stated = referenced(points, {"bench": station.description})
            write_calibration(target, stated, remarks)

        def rest_of_run() -> Plan[CalibrationData]:
            return calibrate_turning(station.devices, side, profile, wait=wait, series_done=done)

        kind = CALIBRATION if profile.kind == "calibration" else VERIFICATION
        settings = {"wait": wait, "series_done": done, "on_series": keep}
        points = kind.measure(
            station, side, profile, settings=settings, rehearsed=rest_of_run, **options
        )
        record = points.record
        rows = len(points.result) + (0 if before is None else len(before.points))
        return TurningRun(record.run_id, rows, record.bench_seconds)
    if isinstance(begun, BegunCalibration | StepTable):
        raise InputError(
            Message("profile {text}", profile.name), "the profile of the interrupted run"
        )
    table = EmptyTable(side) if begun is None else begun

    def write(done: EmptyTable) -> None:
        _write(target, done, station, profile)

    _follow_on(table, station)
    found = EMPTY_RUN.measure(
        station,
        side,
        profile,
        table,
        settings={"wait": wait, "on_series": write},
        rehearsed=lambda: _without_table(station, side, profile),
        **options,
    )
    return TurningRun(found.record.run_id, len(table.rows), found.record.bench_seconds)


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
        stated = {**_remarks(station, side, profile, done.series_done), **remarks}
        rows = [
            f"{time_s:.6f},{reading_nm:.7g},{standard_nm:.7g},{segment:.0f},{period_s:g}"
            for time_s, reading_nm, standard_nm, segment, period_s in done.rows.tolist()
        ]
        _write_table(target, stated, StepTable.COLUMNS, rows)

    found = DYNAMICS.measure(
        station,
        side,
        profile,
        table,
        settings={"on_series": write},
        rehearsed=lambda: _without_table(station, side, profile),
        **options,
    )
    return TurningRun(found.record.run_id, len(table.rows), found.record.bench_seconds)


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
    absolute = station.description.module(table.side).encoder.absolute
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
