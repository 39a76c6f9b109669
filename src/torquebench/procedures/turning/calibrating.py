"""Steady torques at steady speeds against a rotating reference: calibration, verification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.procedures.calibrating import calibration_of_rows
from torquebench.procedures.guarding import loading_limits, turning_limits
from torquebench.procedures.messages import checkpoint, move, prepare, progress, take
from torquebench.procedures.reducers.setup import check_followed, over_turns, stamp, turn_at
from torquebench.procedures.setup import Plan, Setup, measured_in, power_on
from torquebench.procedures.turning.empty import reach_temperature, run_metadata
from torquebench.procedures.turning.profile import TurningPoint, TurningProfile
from torquebench.procedures.zeroing import zero

__all__ = ["calibrate_turning"]


@dataclass
class _Table:
    points: list[TurningPoint] = field(default_factory=list)
    rows: list[Mapping[str, Any]] = field(default_factory=list)


def calibrate_turning(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    *,
    wait: bool = True,
    series_done: int = 0,
    on_series: Callable[[CalibrationData, int], None] | None = None,
) -> Plan[CalibrationData]:
    """Load a turning module against the rotating calibrator.

    Each value is a mean over whole revolutions. Reading and reference are zeroed at rest before
    each series. Points of a calibration without torque at each speed, before and after its
    loadings, show the zero at speed. A verification loads the module with random torques at each of
    its random speeds; the speed changes at zero torque.

    Parameters
    ----------
    devices : BenchDevices
    side : {"input", "output"}
    profile : TurningProfile
        Of kind "calibration" or "verification".
    wait : bool
        Whether a series waits for its temperature.
    series_done : int
        Series that were measured before: they aren't again.
    on_series : callable, optional
        Called after every complete series with the points of this run and the number of complete
        series, those before included.

    Raises
    ------
    LimitError
        Before anything moves, where a torque or speed exceeds the bench.
    SignalFault
        A drive doesn't reach its speed.
    """
    module = devices.context.description.module(side)
    points = profile.points(side, module.range_nm)
    largest = max(abs(point.torque_nm) for point in points)
    todo = [point for point in points if point.series > series_done]
    top, table = profile.top_rpm(side), _Table()
    metadata = run_metadata(devices, "calibrate_turning", side, profile, len(todo))
    setup = Setup("calibration", side, "calibrator", "locked")

    measuring = _loaded(devices, side, profile, todo, table, on_series, wait=wait)
    loading = replace(loading_limits(devices, side, largest), speed_rpm=None, angle_deg=None)
    turning = turning_limits(devices, side, top)
    yield from measured_in(setup, devices, measuring, metadata, turning, loading)
    if not table.rows:
        raise BenchError("a calibration that recorded no point", "at least one point")
    return _data(devices, side, table)


def _loaded(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    points: list[TurningPoint],
    table: _Table,
    on_series: Callable[[CalibrationData, int], None] | None,
    *,
    wait: bool,
) -> Plan[None]:
    drive, steady = devices.module(side).drive, devices.module(side).steady
    top = profile.top_rpm(side)
    rate = top / profile.ramps.gentle_s
    yield from prepare(steady, SteadySettings(reference=True), wait=True)
    present, before, seen = 0.0, 0, devices.interruptions
    largest = max(abs(point.torque_nm) for point in points)
    for number, point in enumerate(points):
        text = Message("{speed_rpm:g} rpm, {torque_nm:g} N·m", point.speed_rpm, point.torque_nm)
        yield from progress(number, len(points), text)
        yield from checkpoint()
        held = devices.interruptions != seen
        seen = devices.interruptions
        if point.series != before or held:
            if present != 0.0 and not held:
                yield from move(drive.torque, 0.0)
                yield from turn_at(devices, side, 0.0, rate)
            if point.series != before:
                if before and on_series is not None and table.rows:
                    on_series(_data(devices, side, table), before)
                before = point.series
                if wait:
                    place = (number, len(points))
                    yield from reach_temperature(devices, side, profile, before - 1, place)
                yield from zero(devices, side, duration_s=profile.zero_s, standard=True)
            yield from power_on(devices, side)
            yield from turn_at(devices, side, point.speed_rpm, rate)
            if held and point.branch < 0:  # the turning point again
                turned = float(np.sign(point.torque_nm)) * largest
                if profile.random is not None:
                    turned = points[number - 1].torque_nm
                yield from move(drive.torque, turned)
        elif point.speed_rpm != present:
            yield from move(drive.torque, 0.0)
            yield from turn_at(devices, side, point.speed_rpm, rate)
        present = point.speed_rpm
        window = over_turns(point.speed_rpm, profile.settle_s, profile.hold_s)
        yield from prepare(steady, replace(window, reference=True), wait=True)
        yield from stamp(
            devices,
            series=point.series,
            step=number,
            branch=point.branch,
            nominal_nm=point.torque_nm,
        )
        yield from move(drive.torque, point.torque_nm)
        row = yield from take(steady, devices.point, stream="points")
        check_followed(row, point.speed_rpm, 0.0, side)
        table.points.append(point)
        table.rows.append(row)
    yield from move(drive.torque, 0.0)
    yield from turn_at(devices, side, 0.0, rate)
    if on_series is not None and table.rows:
        on_series(_data(devices, side, table), before)
    yield from progress(len(points), len(points), "done")


def _data(devices: BenchDevices, side: Side, table: _Table) -> CalibrationData:
    return calibration_of_rows(
        devices,
        side,
        table.rows,
        series=[point.series for point in table.points],
        branch=[point.branch for point in table.points],
        nominal_nm=[point.torque_nm for point in table.points],
    )
