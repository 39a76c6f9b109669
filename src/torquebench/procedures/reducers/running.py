"""Steady running: no-load torque against speed, and efficiency over torque and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.devices import BenchDevices
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures.guarding import torque_limits, turning_limits
from torquebench.procedures.messages import checkpoint, move, progress, read, sleep
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.running_table import (
    RunningPoint,
    RunningRecording,
    RunningTable,
)
from torquebench.procedures.reducers.setup import (
    REDUCER_SETUP,
    ReducerLimits,
    WarmUp,
    directions,
    over_turns,
    run_metadata,
    stamp,
    turn_at,
    turn_output,
    warm_up,
)
from torquebench.procedures.setup import REST_S, Plan, measured_in, power_off
from torquebench.reducers.repeatability import errors_of_means
from torquebench.units import RAD_S_PER_RPM

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class NoLoadSettings:
    """Settings of the no-load running torque.

    Parameters
    ----------
    sweep : FrictionSettings
        Speeds, repeats, directions and windows; in the mean of both directions, errors of the zero
        cancel. Oscillations of a free output after a change of speed decay within a second.
    warm_up : WarmUp
        Warm-up before the first point.
    target_percent : float or None
        Further repeats follow until twice the standard error of every mean over directions and
        repeats is at most this share of it, %; None for the repeats of the sweep alone. A torque
        without compensation isn't repeated, because its uncertainty wouldn't decrease.
    most_repeats : int
        Largest number of repeats.
    """

    sweep: FrictionSettings = field(
        default_factory=lambda: FrictionSettings(settle_s=1.0, window_s=1.0)
    )
    warm_up: WarmUp = field(default_factory=WarmUp)
    target_percent: float | None = 0.5
    most_repeats: int = 12

    def __post_init__(self) -> None:
        _check_target("target_percent", self.target_percent, "%")

    def longest(self) -> NoLoadSettings:
        """Return the settings with the largest number of repeats."""
        if not _repeats_on(self.target_percent, self.sweep.repeats):
            return self
        repeats = max(self.sweep.repeats, self.most_repeats)
        return replace(self, sweep=replace(self.sweep, repeats=repeats), target_percent=None)

    def with_repeats(self, most: int) -> NoLoadSettings:
        """Return the settings with at most so many repeats."""
        sweep = replace(self.sweep, repeats=min(self.sweep.repeats, most))
        return replace(self, sweep=sweep, most_repeats=most)

    def within(self, limits: ReducerLimits) -> NoLoadSettings:
        """Return the settings without the speeds that the reducer's data sheet doesn't allow."""
        speeds = limits.reachable(self.sweep.speeds_rpm)
        return replace(self, sweep=replace(self.sweep, speeds_rpm=speeds))


@dataclass(frozen=True)
class EfficiencySettings:
    """Torques and speeds of the efficiency map, and the duration of each point.

    Parameters
    ----------
    torque_shares : tuple of float
        Shares of the rated torque.
    speeds_rpm : tuple of float
        Input speeds, 1/min.
    clockwise, counter_clockwise : bool
        Directions to be driven; in the mean of both, errors of the zeros cancel.
    repeats : int
        Number of passes over the map, each after new zeros without load: only over these does a
        chain's scatter between loadings average out.
    target_points : float or None
        Further repeats follow at torques at which twice the standard error of a mean over
        directions and repeats exceeds this number of percentage points of efficiency; None for
        `repeats` alone. Without compensation on both sides there are no further repeats.
    most_repeats : int
        Largest number of repeats.
    settle_s, window_s : float
        Time before a window, and its shortest length; it is lengthened to whole input turns, s.
    zero_s : float
        Length of the zeros before each speed, s.
    warm_up : WarmUp
        Warm-up before the first point, without load.
    """

    torque_shares: tuple[float, ...] = (0.2, 0.25, 0.5, 0.75, 1.0)
    speeds_rpm: tuple[float, ...] = (150.0, 300.0, 600.0, 900.0, 1200.0)
    clockwise: bool = True
    counter_clockwise: bool = True
    repeats: int = 3
    target_points: float | None = 0.2
    most_repeats: int = 12
    settle_s: float = 1.0
    window_s: float = 2.0
    zero_s: float = 1.0
    warm_up: WarmUp = field(default_factory=WarmUp)

    def __post_init__(self) -> None:
        """Refuse settings without points, repeats or a possible target."""
        for name in ("torque_shares", "speeds_rpm"):
            values = getattr(self, name)
            if not values or min(values) <= 0.0:
                raise InputError(
                    Message("{name} {values}", name, values), "at least one value, all above 0"
                )
        if self.repeats < 1:
            raise InputError(Message("{most} repeats", self.repeats), "at least 1")
        directions(self)
        _check_target("target_points", self.target_points, "percentage points")

    def within(self, limits: ReducerLimits) -> EfficiencySettings:
        """Return the settings without the speeds that the reducer's data sheet doesn't allow."""
        return replace(self, speeds_rpm=limits.reachable(self.speeds_rpm))

    def longest(self) -> EfficiencySettings:
        """Return the settings with the largest number of repeats."""
        if not _repeats_on(self.target_points, self.repeats):
            return self
        return replace(self, repeats=max(self.repeats, self.most_repeats), target_points=None)

    def with_repeats(self, most: int) -> EfficiencySettings:
        """Return the settings with at most so many repeats."""
        return replace(self, repeats=min(self.repeats, most), most_repeats=most)


def _repeats_on(target: float | None, repeats: int) -> bool:
    """Return whether further repeats may follow; a single requested repeat excludes them."""
    return target is not None and repeats > 1


def _check_target(name: str, target: float | None, unit: str) -> None:
    if target is not None and not target > 0.0:
        raise InputError(
            Message("{name} {target:g}", name, target), Message("more than 0 {unit}, or none", unit)
        )


def no_load_running(
    devices: BenchDevices, limits: ReducerLimits, settings: NoLoadSettings | None = None
) -> Plan[RunningRecording]:
    """Drive the input at steps of speed with the output free, and read the required torque.

    The torque is zeroed before every series (one direction of one repeat) and after the last, so
    that the zero drift during rotation can be subtracted. The sweep is repeated until the means
    reach the target uncertainty of the settings.

    Raises
    ------
    LimitError
        A speed exceeds the limits of data sheet or bench; nothing has moved yet.
    BenchError
        The reducer doesn't turn by its ratio, or doesn't reach a steady temperature.
    SignalFault
        The drive saturates.
    """
    settings = settings or NoLoadSettings()
    limits.check_input_speed(settings.sweep.speeds_rpm[-1])
    points = sum(1 for _ in settings.sweep.points())
    table = RunningTable(devices, ("input",))
    metadata = run_metadata(
        devices, "no_load_running", limits, points, settings=asdict(settings), side="input"
    )

    def measured() -> Plan[None]:
        yield from _start(devices, limits, settings.warm_up)
        yield from _sweeps(devices, settings, table)

    speed = turning_limits(
        devices, "input", _fastest(limits, settings.warm_up, settings.sweep.speeds_rpm)
    )
    yield from measured_in(REDUCER_SETUP, devices, measured(), metadata, speed)
    return table.recording()


def _fastest(limits: ReducerLimits, warm: WarmUp, speeds_rpm: Sequence[float]) -> float:
    """Return the largest input speed of a test, 1/min."""
    warming = min(warm.speed_rpm, limits.largest_input_rpm) if warm.longest_s else 0.0
    return max(*speeds_rpm, warming, limits.turning_rpm)


def _start(devices: BenchDevices, limits: ReducerLimits, warm: WarmUp) -> Plan[None]:
    """Check that the reducer turns by its ratio, and warm it up."""
    yield from progress(0, 0, "checking the ratio")
    yield from checkpoint()
    yield from turn_output(devices, limits, 10.0)
    yield from warm_up(devices, limits, warm)


def _sweeps(devices: BenchDevices, settings: NoLoadSettings, table: RunningTable) -> Plan[None]:
    """Repeat all speeds until their means reach the target uncertainty."""
    sweep, repeat = settings.sweep, 1
    while True:
        planned = max(repeat, sweep.repeats)
        yield from _sweep(devices, sweep, repeat, planned, table)
        if repeat >= sweep.repeats and not _more_sweeps(settings, repeat, table):
            break
        repeat += 1
    yield from turn_at(devices, "input", 0.0, sweep.rate_rpm_per_s)
    yield from table.zero(sweep.zero_s)
    yield from progress(len(table.rows), len(table.rows), "done")


def _more_sweeps(settings: NoLoadSettings, done: int, table: RunningTable) -> bool:
    """Return whether a target for U requires a further sweep."""
    target = settings.target_percent
    if target is None or not _repeats_on(target, settings.sweep.repeats):
        return False
    if done >= settings.most_repeats or not table.compensated():
        return False
    recording = table.recording()
    smallest, error = errors_of_means(
        recording.torque_nm["input"] * recording.direction,
        np.abs(recording.nominal_rpm),
        recording.direction,
        recording.repeat,
    )
    return 2.0 * error > 0.01 * target * smallest


def _sweep(
    devices: BenchDevices,
    sweep: FrictionSettings,
    repeat: int,
    planned: int,
    table: RunningTable,
) -> Plan[None]:
    """Measure one sweep over all speeds, and zero before each series."""
    points, series = list(sweep.repeat(repeat)), None
    for number, point in enumerate(points, start=len(points) * (repeat - 1)):
        text = Message("repeat {repeat}, {speed_rpm:g} rpm", point.repeat, point.speed_rpm)
        yield from progress(number, len(points) * planned, text)
        yield from checkpoint()
        if point.series != series:
            series = point.series
            yield from turn_at(devices, "input", 0.0, sweep.rate_rpm_per_s)
            yield from table.zero(sweep.zero_s)
        yield from stamp(
            devices,
            series=point.series,
            step=point.number,
            branch=point.branch,
            group=point.repeat,
        )
        yield from turn_at(devices, "input", point.speed_rpm, sweep.rate_rpm_per_s)
        running = RunningPoint(point.speed_rpm, 0.0, point.branch, point.repeat)
        yield from table.take(running, sweep.steady(point.speed_rpm))


def efficiency_map(
    devices: BenchDevices, limits: ReducerLimits, settings: EfficiencySettings | None = None
) -> Plan[RunningRecording]:
    """Drive the input at a speed against a braking torque at the output, over a grid of both.

    Both sides are driven: the input by speed, the output by torque. Both torques are means over the
    same window of whole input turns. Torques at which the efficiency misses the target uncertainty
    of the settings are repeated.

    Raises
    ------
    LimitError
        A torque or speed exceeds the limits of data sheet or bench; nothing has moved yet.
    BenchError
        The reducer doesn't turn by its ratio, or doesn't reach a steady temperature.
    SignalFault
        A drive saturates.
    """
    settings = settings or EfficiencySettings()
    limits.check_input_speed(max(settings.speeds_rpm))
    limits.check_output_torque(max(settings.torque_shares) * limits.rated_torque_nm)
    points = settings.repeats * len(_grid(limits, settings, settings.torque_shares, 1))
    table = RunningTable(devices, ("input", "output"))
    metadata = run_metadata(
        devices, "efficiency_map", limits, points, settings=asdict(settings), side="output"
    )

    def measured() -> Plan[None]:
        yield from _start(devices, limits, settings.warm_up)
        yield from _load_grids(devices, limits, settings, table)

    speed = turning_limits(
        devices, "input", _fastest(limits, settings.warm_up, settings.speeds_rpm)
    )
    largest_nm = max(settings.torque_shares) * limits.rated_torque_nm
    torque = torque_limits(devices, "output", largest_nm)
    yield from measured_in(REDUCER_SETUP, devices, measured(), metadata, speed, torque)
    return table.recording()


def _grid(
    limits: ReducerLimits, settings: EfficiencySettings, shares: Sequence[float], repeat: int
) -> list[RunningPoint]:
    """Return the points of a repeat: torques rise at each speed, and oppose the output's motion."""
    turn = float(np.sign(limits.ratio))
    return [
        RunningPoint(sign * speed, -turn * sign * share * limits.rated_torque_nm, 1, repeat)
        for sign in directions(settings)
        for speed in settings.speeds_rpm
        for share in shares
    ]


def _load_grids(
    devices: BenchDevices, limits: ReducerLimits, settings: EfficiencySettings, table: RunningTable
) -> Plan[None]:
    """Measure the map, then repeat the torques whose means miss the target uncertainty."""
    shares: Sequence[float] = settings.torque_shares
    total = settings.repeats * len(_grid(limits, settings, shares, 1))
    repeat = 0
    while shares:
        repeat += 1
        points = _grid(limits, settings, shares, repeat)
        total = max(total, len(table.rows) + len(points))
        yield from _load_grid(devices, settings, points, total, table)
        if repeat >= settings.repeats:
            shares = _open_shares(limits, settings, shares, repeat, table)
    yield from _stop(devices)
    yield from table.zero(settings.zero_s)
    yield from progress(len(table.rows), len(table.rows), "done")


def _open_shares(
    limits: ReducerLimits,
    settings: EfficiencySettings,
    shares: Sequence[float],
    done: int,
    table: RunningTable,
) -> Sequence[float]:
    """Return the shares of rated torque at which the efficiency needs more repeats for its U."""
    target = settings.target_points
    if target is None or not _repeats_on(target, settings.repeats):
        return ()
    if done >= settings.most_repeats or not table.compensated():
        return ()
    points = table.recording()
    torque_nm = points.torque_nm
    percent = 100.0 * np.abs(torque_nm["output"] / (limits.ratio * torque_nm["input"]))
    open_shares = []
    for share in shares:
        rows = np.isclose(np.abs(points.nominal_nm), share * limits.rated_torque_nm)
        _, error = errors_of_means(
            percent[rows],
            np.abs(points.nominal_rpm[rows]),
            points.direction[rows],
            points.repeat[rows],
        )
        if 2.0 * error > target:
            open_shares.append(share)
    return open_shares


def _load_grid(
    devices: BenchDevices,
    settings: EfficiencySettings,
    points: Sequence[RunningPoint],
    total: int,
    table: RunningTable,
) -> Plan[None]:
    """Measure the points of one repeat; both sides are stopped and zeroed before each new speed."""
    speed_axis, torque_axis = devices.input.drive.speed, devices.output.drive.torque
    present: float | None = None
    for number, point in enumerate(points, start=len(table.rows)):
        text = Message(
            "repeat {repeat}, {speed_rpm:g} rpm, {torque_nm:g} N·m",
            point.repeat,
            point.speed_rpm,
            abs(point.torque_nm),
        )
        yield from progress(number, total, text)
        yield from checkpoint()
        if point.speed_rpm != present:
            present = point.speed_rpm
            yield from _stop(devices)
            yield from table.zero(settings.zero_s)
        yield from stamp(
            devices, series=point.repeat, step=number, branch=1, nominal_nm=point.torque_nm
        )
        yield from move(speed_axis, point.speed_rpm * RAD_S_PER_RPM)
        yield from move(torque_axis, point.torque_nm)
        yield from sleep(settings.settle_s)
        yield from table.take(point, over_turns(point.speed_rpm, 0.0, settings.window_s))


def _stop(devices: BenchDevices) -> Plan[None]:
    """Remove the load first, then stop the shafts."""
    for axis in (devices.output.drive.torque, devices.input.drive.speed):
        present = yield from read(axis.setpoint)
        if present != 0.0:
            yield from move(axis, 0.0)
    yield from sleep(REST_S)
    yield from power_off(devices)
