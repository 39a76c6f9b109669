"""Steady torques at steady speeds against a rotating reference: calibration, verification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.procedures.calibrating import calibration_of_rows
from torquebench.procedures.guarding import loading_limits, turning_limits
from torquebench.procedures.messages import again_after_pause, move, prepare, progress, take
from torquebench.procedures.reducers.setup import check_followed, over_turns, stamp, turn_at
from torquebench.procedures.setup import Plan, Setup, measured_in, power_on
from torquebench.procedures.turning.empty import reach_temperature, run_metadata
from torquebench.procedures.turning.profile import TurningPoint, TurningProfile
from torquebench.procedures.zeroing import zero


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
    each series. In a calibration, points without torque before and after the loadings of each speed
    show the zero at speed. A verification loads the module with random torques at each of its
    random speeds; the speed changes at zero torque.

    Parameters
    ----------
    side : {"input", "output"}
    profile : TurningProfile
        Profile of kind "calibration" or "verification".
    wait : bool
        Whether a series waits for its temperature.
    series_done : int
        Number of series that were already measured and are skipped.
    on_series : callable, optional
        Called after every complete series with the points of this run and the number of complete
        series, earlier ones included.

    Raises
    ------
    LimitError
        A torque or speed exceeds the limits of the bench; nothing has moved yet.
    SignalFault
        A drive doesn't reach its speed.
    """
    module = devices.context.description.module(side)
    points = profile.points(side, module.range_nm)
    largest = max(abs(point.torque_nm) for point in points)
    todo = [point for point in points if point.series > series_done]
    top = profile.top_rpm(side)
    metadata = run_metadata(devices, "calibrate_turning", side, profile, len(todo))
    setup = Setup("calibration", side, "calibrator", "locked")

    loader = _Loader(devices, side, profile, todo, wait=wait, on_series=on_series)
    loading = replace(loading_limits(devices, side, largest), speed_rpm=None, angle_deg=None)
    turning = turning_limits(devices, side, top)
    yield from measured_in(setup, devices, loader.run(), metadata, turning, loading)
    if not loader.rows:
        raise BenchError("a calibration that recorded no point", "at least one point")
    return loader.data()


@dataclass
class _Loader:
    """Loads the points of a turning module in turn."""

    devices: BenchDevices
    side: Side
    profile: TurningProfile
    points: list[TurningPoint]
    wait: bool
    on_series: Callable[[CalibrationData, int], None] | None
    rows: list[Mapping[str, Any]] = field(default_factory=list)
    speed_rpm: float = 0.0
    series: int = 0

    def run(self) -> Plan[None]:
        """Measure all points, each again after a pause."""
        yield from prepare(self._module.steady, SteadySettings(reference=True), wait=True)
        for number, point in enumerate(self.points):
            text = Message("{speed_rpm:g} rpm, {torque_nm:g} N·m", point.speed_rpm, point.torque_nm)
            yield from progress(number, len(self.points), text)
            self.rows.append(
                (
                    yield from again_after_pause(
                        partial(self._point, number), partial(self._restore, number)
                    )
                )
            )
        yield from self._turn(0.0)
        self._end_series()
        yield from progress(len(self.points), len(self.points), "done")

    def _point(self, number: int) -> Plan[Mapping[str, Any]]:
        """Bring the module to the speed and torque of a point, and measure its steady value."""
        point, profile, steady = self.points[number], self.profile, self._module.steady
        if point.series != self.series:
            if self.speed_rpm != 0.0:
                yield from self._turn(0.0)
            self._end_series()
            self.series = point.series
            if self.wait:
                steps = number, len(self.points)
                yield from reach_temperature(
                    self.devices, self.side, profile, point.series - 1, steps
                )
            yield from zero(self.devices, self.side, duration_s=profile.zero_s, standard=True)
            yield from self._turn(point.speed_rpm)
        elif point.speed_rpm != self.speed_rpm:
            yield from self._turn(point.speed_rpm)
        window = over_turns(point.speed_rpm, profile.settle_s, profile.hold_s)
        yield from prepare(steady, replace(window, reference=True), wait=True)
        yield from stamp(
            self.devices,
            series=point.series,
            step=number,
            branch=point.branch,
            nominal_nm=point.torque_nm,
        )
        yield from move(self._module.drive.torque, point.torque_nm)
        row = yield from take(steady, self.devices.point, stream="points")
        check_followed(row, point.speed_rpm, 0.0, self.side)
        return row

    def _turn(self, speed_rpm: float) -> Plan[None]:
        """Ramp the shaft to a speed, without torque."""
        rate = self.profile.top_rpm(self.side) / self.profile.ramps.gentle_s
        yield from move(self._module.drive.torque, 0.0)
        yield from turn_at(self.devices, self.side, speed_rpm, rate)
        self.speed_rpm = speed_rpm

    def _restore(self, number: int) -> Plan[None]:
        """Turn the shaft again after a pause; load the turning point of a falling branch."""
        point = self.points[number]
        if point.series != self.series:  # a series begins at rest
            self.speed_rpm = 0.0
            return
        yield from power_on(self.devices, self.side)
        yield from self._turn(self.speed_rpm)
        if point.branch < 0:
            before = self.points[:number]
            if self.profile.random is None:
                before = [earlier for earlier in before if earlier.branch > 0]
            turning_point = before[-1].torque_nm
            yield from move(self._module.drive.torque, turning_point)

    def _end_series(self) -> None:
        """Report that a series is complete."""
        if self.rows and self.on_series is not None:
            self.on_series(self.data(), self.series)

    def data(self) -> CalibrationData:
        """Return the points measured so far."""
        points = self.points[: len(self.rows)]
        return calibration_of_rows(
            self.devices,
            self.side,
            self.rows,
            series=[point.series for point in points],
            branch=[point.branch for point in points],
            nominal_nm=[point.torque_nm for point in points],
        )

    @property
    def _module(self) -> Any:
        return self.devices.module(self.side)
