"""Calibration against a rotating reference: steady torques at steady speeds, zero at speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import numpy as np

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.interlocks import standard_serial
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.errors import BenchError, LimitError
from torquebench.procedures.guarding import StepLimits, guarded, loading_limits, turning_limits
from torquebench.procedures.messages import checkpoint, move, progress, take
from torquebench.procedures.reducers.setup import check_followed, stamp, turn_at
from torquebench.procedures.setup import Plan, Setup, power_on, set_up, unloaded_after
from torquebench.procedures.turning.empty import run_metadata
from torquebench.procedures.turning.profile import TurningPoint, TurningProfile
from torquebench.procedures.zeroing import zero

__all__ = ["calibrate_turning", "series_of"]


@dataclass
class _Table:
    points: list[TurningPoint] = field(default_factory=list)
    series: list[int] = field(default_factory=list)
    rows: list[Mapping[str, Any]] = field(default_factory=list)


def calibrate_turning(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    *,
    series_done: int = 0,
    on_series: Callable[[CalibrationData, int], None] | None = None,
) -> Plan[CalibrationData]:
    """Load a turning module against the rotating calibrator.

    Each value is a mean over whole revolutions. Reading and reference are zeroed at rest; points
    without torque at each speed, before and after its loadings, show the zero at speed. Numbers of
    series count the speeds.

    Parameters
    ----------
    devices : BenchDevices
    side : {"input", "output"}
    profile : TurningProfile
        Of kind "calibration".
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
    if largest > module.limits.torque_nm:
        raise LimitError(f"{largest:g} N·m at the {side}", f"at most {module.limits.torque_nm:g}")
    todo = [each for each in zip(points, series_of(points), strict=True) if each[1] > series_done]
    top, table = profile.top_rpm(side), _Table()
    metadata = {
        **run_metadata(devices, side, profile, len(todo)),
        "plan_name": "calibrate_turning",
    }
    setup = Setup("calibration", side, "calibrator", "locked")

    def in_bench() -> Plan[None]:
        yield from set_up(devices, setup)
        metadata["standard_serial"] = standard_serial(devices.context.state)
        body = _loaded(devices, side, profile, todo, table, on_series)
        yield from bpp.run_wrapper(body, md=metadata)

    loading = loading_limits(devices, side, largest)
    torque = StepLimits(
        side, torque_nm=loading.torque_nm, torque_rate_nm_per_s=loading.torque_rate_nm_per_s
    )
    limits = turning_limits(devices, side, top)
    yield from guarded(lambda: unloaded_after(devices, in_bench), limits, torque)
    if not table.rows:
        raise BenchError("a calibration that recorded no point", "at least one point")
    return _data(devices, side, table)


def series_of(points: Sequence[TurningPoint]) -> list[int]:
    """Return the number of the series of each point, from 1: one at each speed."""
    speeds = np.array([point.speed_rpm for point in points])
    numbers = 1 + np.cumsum(np.diff(speeds) != 0.0)
    return [1, *map(int, numbers)]


def _loaded(
    devices: BenchDevices,
    side: Side,
    profile: TurningProfile,
    points: list[tuple[TurningPoint, int]],
    table: _Table,
    on_series: Callable[[CalibrationData, int], None] | None,
) -> Plan[None]:
    drive, steady = devices.module(side).drive, devices.module(side).steady
    top = profile.top_rpm(side)
    rate = top / profile.ramps.gentle_s
    yield from bps.prepare(steady, SteadySettings(reference=True), wait=True)
    present, before, seen = 0.0, 0, devices.interruptions
    for number, (point, series) in enumerate(points):
        text = f"{point.speed_rpm:g} rpm, {point.torque_nm:g} N·m"
        yield from progress(number, len(points), text)
        yield from checkpoint()
        held = devices.interruptions != seen
        seen = devices.interruptions
        if series != before or held:
            if present != 0.0 and not held:
                yield from move(drive.torque, 0.0)
                yield from turn_at(devices, side, 0.0, rate)
            if series != before:
                if before and on_series is not None and table.rows:
                    on_series(_data(devices, side, table), before)
                before = series
                yield from zero(devices, side, duration_s=profile.zero_s, standard=True)
            present = point.speed_rpm
            yield from power_on(devices, side)
            yield from turn_at(devices, side, present, rate)
            if held and point.branch < 0 and point.torque_nm != 0.0:  # the turning point again
                turned = np.sign(point.torque_nm) * max(abs(p.torque_nm) for p, _ in points)
                yield from move(drive.torque, float(turned))
        period_s = 60.0 / abs(point.speed_rpm)
        window = SteadySettings(
            profile.settle_s, profile.turning_s(point.speed_rpm), 0.0, period_s, reference=True
        )
        yield from bps.prepare(steady, window, wait=True)
        yield from stamp(
            devices, series=series, step=number, branch=point.branch, target_nm=point.torque_nm
        )
        yield from move(drive.torque, point.torque_nm)
        row = yield from take(steady, devices.point, stream="points")
        check_followed(row, point.speed_rpm, 0.0, side)
        table.points.append(point)
        table.series.append(series)
        table.rows.append(row)
    yield from move(drive.torque, 0.0)
    yield from turn_at(devices, side, 0.0, rate)
    if on_series is not None and table.rows:
        on_series(_data(devices, side, table), before)
    yield from progress(len(points), len(points), "done")


def _data(devices: BenchDevices, side: Side, table: _Table) -> CalibrationData:
    context = devices.context

    def column(name: str) -> np.ndarray[Any, Any]:
        return np.array([row[name] for row in table.rows], dtype=np.float64)

    known = all("true_torque_nm" in row for row in table.rows)
    module = context.description.module(side)
    return CalibrationData(
        reading_nm=column("reading_nm"),
        standard_nm=column("standard_nm"),
        series=np.array(table.series),
        branch=np.array([point.branch for point in table.points]),
        range_nm=module.range_nm,
        side=side,
        transducer_serial=module.transducer.serial,
        counter_identity=context.drivers.counter.clock_identity,
        nominal_nm=np.array([point.torque_nm for point in table.points]),
        speed_rpm=column("speed_rpm"),
        temperature_c=column("temperature_c"),
        time_s=column("time_s"),
        standard_error_nm=column("reading_standard_error_nm"),
        true_torque_nm=column("true_torque_nm") if known else None,
    ).zeroed_each_series()
