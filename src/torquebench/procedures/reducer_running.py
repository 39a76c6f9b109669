"""Steady running: no-load torque against speed, and efficiency over torque and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import numpy as np
from bluesky.utils import Msg
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices, SteadySettings
from torquebench.bench.drivers.base import SIDES, Side
from torquebench.errors import InputError
from torquebench.procedures.friction import FrictionPoint, FrictionSettings
from torquebench.procedures.guarding import (
    StepLimits,
    guarded,
    loading_limits,
    turning_limits,
)
from torquebench.procedures.messages import checkpoint, move, progress
from torquebench.procedures.reducer_setup import (
    RAD_S_PER_RPM,
    TURN_RPM,
    ReducerLimits,
    WarmUp,
    check_followed,
    run_metadata,
    stamp,
    temperature_c,
    turn_output,
    warm_up,
)
from torquebench.procedures.setup import (
    REST_S,
    Plan,
    Setup,
    power_off,
    power_on,
    set_mode,
    set_up,
    unloaded_after,
)
from torquebench.procedures.zeroing import measure_zero, zero

__all__ = [
    "EfficiencySettings",
    "NoLoadSettings",
    "RunningRecording",
    "efficiency_map",
    "no_load_running",
]

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class NoLoadSettings:
    """How the no-load running torque is measured.

    Parameters
    ----------
    sweep : FrictionSettings
        Speeds, repeats, directions and windows.
    warm_up : WarmUp
        Before the first point.
    """

    sweep: FrictionSettings = field(default_factory=FrictionSettings)
    warm_up: WarmUp = field(default_factory=WarmUp)

    def within(self, limits: ReducerLimits) -> NoLoadSettings:
        """Return the settings without the speeds that the reducer's data sheet doesn't allow."""
        speeds = tuple(s for s in self.sweep.speeds_rpm if s <= limits.largest_input_rpm)
        values = {**self.sweep.__dict__, "speeds_rpm": speeds}
        return NoLoadSettings(FrictionSettings(**values), self.warm_up)


@dataclass(frozen=True)
class EfficiencySettings:
    """Which torques and speeds the efficiency map has, and how long each point takes.

    Parameters
    ----------
    torque_shares : tuple of float
        Shares of the rated torque.
    speeds_rpm : tuple of float
        Input speeds, 1/min.
    clockwise, counter_clockwise : bool
        Directions that are driven.
    settle_s, window_s : float
        Time before a window, and its shortest length; it is lengthened to whole input turns, s.
    zero_s : float
        Length of the zeros before each speed, s.
    warm_up : WarmUp
        Before the first point, without load.
    """

    torque_shares: tuple[float, ...] = (0.2, 0.25, 0.5, 0.75, 1.0)
    speeds_rpm: tuple[float, ...] = (150.0, 300.0, 600.0, 900.0, 1200.0)
    clockwise: bool = True
    counter_clockwise: bool = False
    settle_s: float = 1.0
    window_s: float = 2.0
    zero_s: float = 1.0
    warm_up: WarmUp = field(default_factory=WarmUp)

    def __post_init__(self) -> None:
        for name in ("torque_shares", "speeds_rpm"):
            values = getattr(self, name)
            if not values or min(values) <= 0.0:
                raise InputError(f"{name} {values}", "at least one value, all above 0")
        if not (self.clockwise or self.counter_clockwise):
            raise InputError("no direction", "clockwise, counter-clockwise or both")

    def within(self, limits: ReducerLimits) -> EfficiencySettings:
        """Return the settings without the speeds that the reducer's data sheet doesn't allow."""
        speeds = tuple(s for s in self.speeds_rpm if s <= limits.largest_input_rpm)
        return EfficiencySettings(**{**self.__dict__, "speeds_rpm": speeds})


@dataclass(frozen=True, eq=False)
class RunningRecording:
    """Steady torques of both sides at each point of a test with turning input.

    Parameters
    ----------
    nominal_rpm, nominal_nm : float64[n]
        Input speed and output torque that were asked for.
    speed_rpm : mapping of side to float64[n]
        Mean speeds, clockwise positive, 1/min.
    torque_nm : mapping of side to float64[n]
        Torque that the module applies, compensated where `compensated`, and corrected for what
        the zero drifted between the zeros before and after, N·m.
    standard_error_nm : mapping of side to float64[n]
        Standard error of each mean, N·m.
    model_uncertainty_nm : mapping of side to float64[n]
        Standard uncertainty of the active model; NaN without one.
    zero_uncertainty_nm : mapping of side to float
        Standard uncertainty that the zero leaves, N·m.
    true_torque_nm : mapping of side to float64[n] or None
        The twin's; None on a real bench.
    direction, branch, repeat : int[n]
        +1 clockwise; +1 while the speed rises; 1, 2, 3.
    temperature_c : float64[n]
        Of the reducer; NaN without a probe.
    time_s : float64[n]
        Bench time, s.
    compensated : mapping of side to bool
    unsettled : int
        Points that were taken although a reading still drifted.
    """

    nominal_rpm: FloatArray
    nominal_nm: FloatArray
    speed_rpm: dict[Side, FloatArray]
    torque_nm: dict[Side, FloatArray]
    standard_error_nm: dict[Side, FloatArray]
    model_uncertainty_nm: dict[Side, FloatArray]
    zero_uncertainty_nm: dict[Side, float]
    true_torque_nm: dict[Side, FloatArray] | None
    direction: NDArray[np.int64]
    branch: NDArray[np.int64]
    repeat: NDArray[np.int64]
    temperature_c: FloatArray
    time_s: FloatArray
    compensated: dict[Side, bool]
    unsettled: int


@dataclass(frozen=True)
class _Asked:
    """One point: what is asked for, and where it stands."""

    speed_rpm: float
    torque_nm: float
    branch: int
    repeat: int


@dataclass
class _Table:
    """Gathers points and the zeros between them."""

    devices: BenchDevices
    sides: tuple[Side, ...]
    asked: list[_Asked] = field(default_factory=list)
    rows: list[dict[Side, Row]] = field(default_factory=list)
    temperatures: list[float] = field(default_factory=list)
    zeros: dict[Side, list[tuple[float, float]]] = field(
        default_factory=lambda: {side: [] for side in SIDES}
    )

    def zero(self, duration_s: float) -> Plan[None]:
        """Zero all sides in use; the last of them is driven afterwards, drive on."""
        for side in self.sides[:-1]:
            yield from self._zero(side, (yield from _measured_zero(self.devices, side, duration_s)))
        side = self.sides[-1]
        found = yield from zero(self.devices, side, duration_s=duration_s)
        yield from self._zero(side, found.frequency_hz)
        for other in self.sides[:-1]:
            yield from set_mode(self.devices, other, "driven")
            yield from power_on(self.devices, other)

    def _zero(self, side: Side, frequency_hz: float) -> Plan[None]:
        yield from ()
        self.zeros[side].append((self.devices.context.clock.now(), frequency_hz))

    def take(self, asked: _Asked, settings: SteadySettings) -> Plan[None]:
        """Take the steady torques of all sides in use over the same window."""
        for side in self.sides:
            yield Msg("prepare", self.devices.module(side).steady, settings, group="reducer")
        yield Msg("wait", None, group="reducer")
        for side in self.sides:
            yield Msg("trigger", self.devices.module(side).steady, group="reducer")
        yield Msg("wait", None, group="reducer")
        yield Msg("create", None, name="points")
        rows: dict[Side, Row] = {}
        for side in self.sides:
            steady = self.devices.module(side).steady
            reading = yield Msg("read", steady)
            prefix = f"{steady.name}-"
            rows[side] = {k.removeprefix(prefix): v["value"] for k, v in reading.items()}
        yield Msg("read", self.devices.point)
        warm = yield from temperature_c(self.devices)
        yield Msg("save")
        check_followed(rows["input"], asked.speed_rpm, 0.0, "input")
        if "output" in rows:
            check_followed(rows["output"], 0.0, asked.torque_nm, "output")
        self.asked.append(asked)
        self.rows.append(rows)
        self.temperatures.append(warm)

    # -- what came out ----------------------------------------------------------------------

    def recording(self) -> RunningRecording:
        known = all("true_torque_nm" in row for rows in self.rows for row in rows.values())
        model = {
            side: all("torque_nm" in rows[side] for rows in self.rows) and bool(self.rows)
            for side in self.sides
        }
        torque = {
            side: self._column(side, "torque_nm" if model[side] else "reading_nm")
            - self._drift(side)[0]
            for side in self.sides
        }
        empty = np.full(len(self.rows), np.nan)
        return RunningRecording(
            nominal_rpm=np.array([each.speed_rpm for each in self.asked]),
            nominal_nm=np.array([each.torque_nm for each in self.asked]),
            speed_rpm={side: self._column(side, "speed_rpm") for side in self.sides},
            torque_nm=torque,
            standard_error_nm={
                side: self._column(side, "reading_standard_error_nm") for side in self.sides
            },
            model_uncertainty_nm={
                side: self._column(side, "torque_uncertainty_nm") if model[side] else empty
                for side in self.sides
            },
            zero_uncertainty_nm={side: self._drift(side)[1] for side in self.sides},
            true_torque_nm={side: self._column(side, "true_torque_nm") for side in self.sides}
            if known
            else None,
            direction=np.array([int(np.sign(each.speed_rpm)) for each in self.asked], np.int64),
            branch=np.array([each.branch for each in self.asked], dtype=np.int64),
            repeat=np.array([each.repeat for each in self.asked], dtype=np.int64),
            temperature_c=np.array(self.temperatures),
            time_s=self._column("input", "time_s"),
            compensated=model,
            unsettled=sum(any(not row["settled"] for row in rows.values()) for rows in self.rows),
        )

    def _column(self, side: Side, name: str) -> FloatArray:
        return np.array([rows[side][name] for rows in self.rows], dtype=np.float64)

    def _drift(self, side: Side) -> tuple[FloatArray, float]:
        """Return what the zero in use was off at each point and its standard uncertainty, N·m.

        The zero goes straight from one zeroing to the next; half of what it moved between two
        of them, as a rectangle, is what that may be wrong by.
        """
        zeros = self.zeros[side]
        if len(zeros) < 2 or not self.rows:
            return np.zeros(len(self.rows)), 0.0
        at, frequency = np.array(zeros).T
        scale = self.devices.context.description.module(side).transducer
        per_nm = scale.nominal_sensitivity_hz_per_nm
        time_s = self._column(side, "time_s")
        used = frequency[np.clip(np.searchsorted(at, time_s) - 1, 0, None)]
        drift = (np.interp(time_s, at, frequency) - used) / per_nm
        moved = float(np.sqrt(np.mean(np.diff(frequency) ** 2))) / per_nm
        return drift, 0.5 * moved / np.sqrt(3.0)


def _measured_zero(devices: BenchDevices, side: Side, duration_s: float) -> Plan[float]:
    found = yield from measure_zero(devices, side, duration_s=duration_s)
    return found.frequency_hz


def no_load_running(
    devices: BenchDevices, limits: ReducerLimits, settings: NoLoadSettings | None = None
) -> Plan[RunningRecording]:
    """Drive the input at steps of speed, output free, and read the torque that it needs.

    Zeroes before every series (one direction of one repeat) and after the last, so that the
    transducer's drift while it turns can be taken out.

    Raises
    ------
    LimitError
        Before anything moves, where a speed exceeds the data sheet or the bench.
    BenchError
        The reducer doesn't turn by its ratio, or doesn't get to a steady temperature.
    SignalFault
        The drive saturates.
    """
    settings = settings or NoLoadSettings()
    limits.check_input_speed(settings.sweep.speeds_rpm[-1])
    points = list(settings.sweep.points())
    table = _Table(devices, ("input",))
    metadata = run_metadata(
        devices, "no_load_running", limits, len(points), settings=asdict(settings), side="input"
    )

    def measured() -> Plan[None]:
        yield from _start(devices, limits, settings.warm_up)
        yield from _sweep(devices, settings.sweep, points, table)

    def in_bench() -> Plan[None]:
        yield from set_up(devices, Setup("reducer_test", "input", "reducer", "free"))
        yield from bpp.run_wrapper(measured(), md=metadata)

    speed = turning_limits(
        devices, "input", _fastest(limits, settings.warm_up, settings.sweep.speeds_rpm)
    )
    yield from guarded(lambda: unloaded_after(devices, in_bench), speed)
    return table.recording()


def _fastest(limits: ReducerLimits, warm: WarmUp, speeds_rpm: Sequence[float]) -> float:
    """Return the largest input speed that a test asks for, 1/min."""
    warming = min(warm.speed_rpm, limits.largest_input_rpm) if warm.longest_s else 0.0
    return max(*speeds_rpm, warming, TURN_RPM)


def _start(devices: BenchDevices, limits: ReducerLimits, warm: WarmUp) -> Plan[None]:
    """See that the reducer turns by its ratio, and warm it up."""
    yield from progress(0, 0, "checking the ratio")
    yield from checkpoint()
    yield from turn_output(devices, limits, 10.0)
    yield from warm_up(devices, limits, warm)


def _sweep(
    devices: BenchDevices,
    sweep: FrictionSettings,
    points: Sequence[FrictionPoint],
    table: _Table,
) -> Plan[None]:
    series = None
    for number, point in enumerate(points):
        text = f"repeat {point.repeat}, {point.speed_rpm:g} rpm"
        yield from progress(number, len(points), text)
        yield from checkpoint()
        if (point.repeat, point.series) != series:
            series = (point.repeat, point.series)
            yield from move(devices.input.drive.speed, 0.0)
            yield from table.zero(sweep.zero_s)
        yield from stamp(
            devices,
            series=point.series,
            step=point.number,
            branch=point.branch,
            group=point.repeat,
        )
        yield from move(devices.input.drive.speed, point.speed_rpm * RAD_S_PER_RPM)
        asked = _Asked(point.speed_rpm, 0.0, point.branch, point.repeat)
        yield from table.take(asked, sweep.steady(point.speed_rpm))
    yield from move(devices.input.drive.speed, 0.0)
    yield from table.zero(sweep.zero_s)
    yield from progress(len(points), len(points), "done")


def efficiency_map(
    devices: BenchDevices, limits: ReducerLimits, settings: EfficiencySettings | None = None
) -> Plan[RunningRecording]:
    """Drive the input at a speed against a braking torque at the output, over a grid of both.

    Both sides are driven: the input by speed, the output by torque. Both torques are means over
    the same window of whole input turns.

    Raises
    ------
    LimitError
        Before anything moves, where a torque or speed exceeds the data sheet or the bench.
    BenchError
        The reducer doesn't turn by its ratio, or doesn't get to a steady temperature.
    SignalFault
        A drive saturates.
    """
    settings = settings or EfficiencySettings()
    limits.check_input_speed(max(settings.speeds_rpm))
    limits.check_output_torque(max(settings.torque_shares) * limits.rated_torque_nm)
    points = _grid(limits, settings)
    table = _Table(devices, ("input", "output"))
    metadata = run_metadata(
        devices, "efficiency_map", limits, len(points), settings=asdict(settings), side="output"
    )

    def measured() -> Plan[None]:
        yield from _start(devices, limits, settings.warm_up)
        yield from _load_grid(devices, settings, points, table)

    def in_bench() -> Plan[None]:
        yield from set_up(devices, Setup("reducer_test", "input", "reducer", "free"))
        yield from bpp.run_wrapper(measured(), md=metadata)

    speed = turning_limits(
        devices, "input", _fastest(limits, settings.warm_up, settings.speeds_rpm)
    )
    largest_nm = max(settings.torque_shares) * limits.rated_torque_nm
    torque = loading_limits(devices, "output", largest_nm).torque_nm
    yield from guarded(
        lambda: unloaded_after(devices, in_bench), speed, StepLimits("output", torque_nm=torque)
    )
    return table.recording()


def _grid(limits: ReducerLimits, settings: EfficiencySettings) -> list[_Asked]:
    """All points: a speed's torques rise; the output brakes, so its torque opposes the motion."""
    directions = [1.0] * settings.clockwise + [-1.0] * settings.counter_clockwise
    turn = float(np.sign(limits.ratio))
    return [
        _Asked(sign * speed, -turn * sign * share * limits.rated_torque_nm, 1, repeat)
        for repeat, sign in enumerate(directions, start=1)
        for speed in settings.speeds_rpm
        for share in settings.torque_shares
    ]


def _load_grid(
    devices: BenchDevices, settings: EfficiencySettings, points: Sequence[_Asked], table: _Table
) -> Plan[None]:
    speed_axis, torque_axis = devices.input.drive.speed, devices.output.drive.torque
    present = None
    for number, point in enumerate(points):
        yield from progress(
            number, len(points), f"{point.speed_rpm:g} rpm, {abs(point.torque_nm):g} N·m"
        )
        yield from checkpoint()
        if point.speed_rpm != present:
            present = point.speed_rpm
            yield from _stop(devices)
            yield from table.zero(settings.zero_s)
        yield from stamp(
            devices, series=point.repeat, step=number, branch=1, target_nm=point.torque_nm
        )
        yield from move(speed_axis, point.speed_rpm * RAD_S_PER_RPM)
        yield from move(torque_axis, point.torque_nm)
        yield from bps.sleep(settings.settle_s)
        yield from table.take(point, _steady(settings, point.speed_rpm))
    yield from _stop(devices)
    yield from table.zero(settings.zero_s)
    yield from progress(len(points), len(points), "done")


def _steady(settings: EfficiencySettings, speed_rpm: float) -> SteadySettings:
    period_s = 60.0 / abs(speed_rpm)
    window_s = round(period_s * float(np.ceil(settings.window_s / period_s - 1e-9)), 9)
    return SteadySettings(0.0, window_s, 0.0, period_s)


def _stop(devices: BenchDevices) -> Plan[None]:
    """Take the load off first, then the speed."""
    for axis in (devices.output.drive.torque, devices.input.drive.speed):
        present = yield from bps.rd(axis.setpoint)
        if present != 0.0:
            yield from move(axis, 0.0)
    yield from bps.sleep(REST_S)
    yield from power_off(devices)
